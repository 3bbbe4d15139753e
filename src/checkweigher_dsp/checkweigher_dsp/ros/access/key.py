# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The key of a locked line, and permissions that are signed with it.

The nodes and the page of a line each have the key in a file; it is never sent. A permission is
sent: a time, and the HMAC-SHA256 (RFC 2104) of that time, the service and the request. A node
accepts each permission once, so an eavesdropper can at most repeat the same request once.
"""

import hashlib
import hmac
import os
from pathlib import Path
import stat

from checkweigher_dsp.input_files import read_input
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.records import NANOSECONDS

KEY_FILE = 'CHECKWEIGHER_KEY_FILE'  # environment variable
SHORTEST_KEY = 32  # bytes
LONGEST_AGE = 10.0  # s of a permission; computers whose clocks are further apart permit nothing
_MOST_KEPT = 1000


class Key:
    """A secret by which permissions are signed and checked."""

    def __init__(self, secret: bytes) -> None:
        self._secret = secret

    def sign(self, service: str, asked: str, now: int) -> str:
        """Return a permission to call `service`, a full name, with `asked` at `now`, ns."""
        text = '\0'.join((str(now), service, asked))
        return f'{now} {hmac.new(self._secret, text.encode(), hashlib.sha256).hexdigest()}'


class Lock:
    """What a locked node has been permitted: each permission counts once, for `LONGEST_AGE`."""

    def __init__(self, key: Key) -> None:
        self._key = key
        self._used: dict[str, int] = {}  # permissions by the time from which they are too old
        self._expected: dict[str, int] = {}

    def expect(self, permission: str, now: int) -> None:
        """Keep a permission for a call that follows."""
        end = _end(permission, now)
        _forget(self._expected, now)
        if end and len(self._expected) < _MOST_KEPT:
            self._expected[permission] = end

    def admits(self, service: str, asked: str, now: int) -> bool:
        """Tell whether a permission that was kept is for this call; it is used up then."""
        _forget(self._expected, now)
        for permission in tuple(self._expected):
            if self.opens(permission, service, asked, now):
                del self._expected[permission]
                return True
        return False

    def opens(self, permission: str, service: str, asked: str, now: int) -> bool:
        """Tell whether a permission is for this call; it is used up then."""
        end = _end(permission, now)
        _forget(self._used, now)
        if not end or permission in self._used or len(self._used) >= _MOST_KEPT:
            return False
        signed = self._key.sign(service, asked, int(permission.partition(' ')[0]))
        if not hmac.compare_digest(signed.encode(), permission.encode()):
            return False
        self._used[permission] = end
        return True


def _end(permission: str, now: int) -> int:
    """Return when a permission becomes too old, ns; 0 if it is, or is none."""
    said = permission.partition(' ')[0]
    if not (said.isascii() and said.isdecimal() and len(said) < 20 and len(permission) < 100):
        return 0
    age = round(LONGEST_AGE * NANOSECONDS)
    return int(said) + age if abs(now - int(said)) < age else 0


def _forget(kept: dict[str, int], now: int) -> None:
    for permission in [each for each, end in kept.items() if end <= now]:
        del kept[permission]


def own_key() -> Key | None:
    """Return the key that the environment of this process names, None without one.

    `ParameterError` if the file cannot be used.
    """
    name = os.environ.get(KEY_FILE, '')
    return read_key(Path(name)) if name else None


def read_key(path: Path) -> Key:
    """Return the key of a file that its owner alone may read; else `ParameterError`."""
    try:
        if stat.S_IMODE(path.stat().st_mode) & 0o077:
            raise ParameterError(f'{path}: others may read this key; chmod 600 it')
        secret = read_input(path).strip()
    except OSError as error:
        raise ParameterError(f'{path}: {error.strerror or error}') from None
    if len(secret) < SHORTEST_KEY:
        make = f'openssl rand -hex 32 > {path}'
        raise ParameterError(f'{path}: a key has {SHORTEST_KEY} bytes at least; make one: {make}')
    return Key(secret)

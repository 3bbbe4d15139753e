# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Waiting times after failed logins and signatures, for each account and each address."""

from collections.abc import Callable
import time

_FREE = 3  # number of failures before the first wait: above one, because users mistype passwords
_LONGEST = 300.0  # maximum waiting time in s
_FORGOTTEN = 3600.0  # time in s without a failure after which the count restarts


def keys_of(account: str, address: str) -> tuple[str, str]:
    """Return the two keys of a login attempt: its account and its address."""
    return f'account {account}', f'address {address}'


class Throttle:
    """Waiting times after successive failures of a key, which is an account or an address.

    The waiting time is 1 s after the third failure, and doubles with each further failure up to
    5 min. The count of failures restarts after 1 h without a failure. A successful login resets the
    failures of its account, and also the failures of its address, because all users at the belt
    share one address. The failures of other accounts still count, because otherwise a user who
    guesses the passwords of other users could reset their waiting times by a login. `clock` returns
    the time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # Number of failures, and time of the latest failure in s, by key.
        self._failures: dict[str, tuple[int, float]] = {}

    def wait(self, *keys: str) -> float:
        """Return the longest waiting time in s of the keys, or 0 if an attempt is allowed now."""
        now = self._clock()
        return max(0.0, *(self._until(key) - now for key in keys))

    def _until(self, key: str) -> float:
        count, last = self._failures.get(key, (0, 0.0))
        return last + min(2.0 ** (count - _FREE), _LONGEST) if count >= _FREE else 0.0

    def fail(self, *keys: str) -> None:
        """Count a failure for each key."""
        now = self._clock()
        for key in keys:
            count, last = self._failures.get(key, (0, now))
            self._failures[key] = (1 if now - last > _FORGOTTEN else min(count + 1, 64)), now

    def forget(self, *keys: str) -> None:
        """Reset the failures of each key after a successful login."""
        for key in keys:
            self._failures.pop(key, None)

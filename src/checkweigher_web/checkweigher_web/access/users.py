# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The users of the page: names, roles and argon2 hashes of their passwords."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
import os
from pathlib import Path
import re
from typing import ClassVar
import unicodedata

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.printable import one_line
from checkweigher_core.settings_files import Settings, read_settings, settings_of, write_settings
from checkweigher_core.whole_file import output_error

SHORTEST, LONGEST = 8, 128  # characters of a password
_MODE = 0o600
_OF_OTHERS = 0o077
_HASHER = PasswordHasher()  # argon2id with the parameters of RFC 9106 for little memory
# Of no password: a name that is not there costs an attempt as much time as one that is.
_NOBODY = _HASHER.hash(os.urandom(16))


class Role(IntEnum):
    """What a user may do; each role may do what those before it may."""

    VIEWER = 1
    OPERATOR = 2
    TECHNICIAN = 3


ROLES = tuple(role.name.lower() for role in Role)


class UsersError(SettingsError):
    """Users that cannot be read or changed; one line that says why and what to do."""


@dataclass(frozen=True)
class User(Settings):
    """One user, as in the file."""

    name: str = parameter(text='of the login')
    role: Role = parameter(text='what the user may do', choices=ROLES)
    hash: str = parameter(text='argon2 hash of the password')

    def __post_init__(self) -> None:
        check_name(self.name)
        if not self.hash.startswith('$argon2'):
            raise UsersError('is no argon2 hash; run: checkweigher user password', 'hash')

    def has_password(self, password: str) -> bool:
        """Tell whether this is the password of the user; it takes about 0.1 s."""
        return _is_of(self.hash, password)


def default_users() -> Path:
    """Return where the users are kept unless another file is named."""
    return config_folder() / 'users'


def config_folder() -> Path:
    """Return the folder of the user's own configuration."""
    given = os.environ.get('XDG_CONFIG_HOME', '')
    base = Path(given) if Path(given).is_absolute() else Path.home() / '.config'
    return base / 'checkweigher'


def check_name(name: str) -> str:
    """Return the name of a user as it is written, or raise UsersError."""
    name = unicodedata.normalize('NFC', name)
    if not re.fullmatch(r'[\w@-][\w.@-]{0,63}', name):
        rule = 'a name has up to 64 letters, digits, "_", "-", "@" and "." (not as the first)'
        raise UsersError(f'{one_line(name)!r}: {rule}')
    return name


def hash_password(name: str, password: str) -> str:
    """Return the hash of a new password, or raise UsersError if it is too easy to guess."""
    if not SHORTEST <= len(password) <= LONGEST:
        rule = f'must have {SHORTEST} to {LONGEST} characters'
        raise UsersError(f'the password of {name} has {len(password)}: it {rule}')
    if password.casefold() == name.casefold():
        raise UsersError(f'the password of {name} is the name: choose another one')
    return _HASHER.hash(unicodedata.normalize('NFC', password))


def spend_check_time(password: str) -> None:
    """Spend as much time as a password check."""
    _is_of(_NOBODY, password)


def _is_of(known: str, password: str) -> bool:
    try:
        return _HASHER.verify(known, unicodedata.normalize('NFC', password))
    except (VerificationError, InvalidHashError):
        return False


@dataclass(frozen=True)
class UsersFile(Settings):
    """The file of the users."""

    format: ClassVar[int] = 2
    users: Mapping[str, User] | None = parameter(None, 'users by their names')


def read_users(path: Path) -> dict[str, User]:
    """Return the users of a file by name.

    Raises
    ------
    SettingsError
        If it is not there, is none of users, or others may read it.
    """
    return dict(_read(path).users or {})


def _read(path: Path) -> UsersFile:
    try:
        if os.stat(path).st_mode & _OF_OTHERS:
            text = f'{path}: other users of this machine may use it; run: chmod 600 {path}'
            raise UsersError(text)
        text = path.read_text(encoding='utf-8')
    except FileNotFoundError:
        text = f'{path}: there is no such file; checkweigher user add NAME --role R makes it'
        raise UsersError(text) from None
    except (OSError, UnicodeDecodeError) as error:
        raise UsersError(f'{path}: cannot be read: {error}') from None
    return read_settings(path, UsersFile) if text.startswith('{') else _older(path, text)


def _older(path: Path, text: str) -> UsersFile:
    """Return the users of format 1, which has a line NAME:ROLE:HASH for each."""
    users = {}
    for number, line in enumerate(text.splitlines(), 1):
        if line and not line.startswith('#'):
            name, role, known = [*line.split(':'), '', ''][:3]
            try:
                users[name] = settings_of(User, {'role': role, 'hash': known}, name)
            except SettingsError as error:
                text = f'{path}: line {number}: {error}; a line is NAME:ROLE:HASH'
                raise UsersError(text) from None
    return UsersFile(users=users)


def write_users(path: Path, users: dict[str, User]) -> None:
    """Write a file of users, whole or not at all, for its owner alone.

    Raises
    ------
    OutputError
        If it cannot be written; the one that was there then stays.
    """
    known = _read(path) if path.exists() else UsersFile()
    try:
        if path == default_users():
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_settings(path, replace(known, users=users), _MODE)
    except OSError as error:
        raise output_error(path, error) from None


class UserFile:
    """The users of a file that may change while the page is served.

    A file that cannot be read any more has no users: nobody acts on what may be gone.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._state: tuple[int, ...] = ()
        self._users: dict[str, User] = {}

    def find(self, name: str) -> User | None:
        """Return a user as the file has it now, None if it has none of the name."""
        return self._now().get(unicodedata.normalize('NFC', name))

    def any(self) -> bool:
        """Tell whether the file has a user now."""
        return bool(self._now())

    def _now(self) -> dict[str, User]:
        try:
            status = os.stat(self.path)
            state = status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode
            if state != self._state:
                self._users = read_users(self.path)
                self._state = state
        except (OSError, SettingsError):
            self._users, self._state = {}, ()
        return self._users

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The users of the page: names, roles and argon2 hashes of their passwords."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
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
from checkweigher_core.state_files import changing, make_folder
from checkweigher_core.whole_file import output_error

SHORTEST, LONGEST = 8, 128  # characters of a password
_MODE = 0o600
_OF_OTHERS = 0o077
_HASHER = PasswordHasher()  # argon2id with the parameters of RFC 9106 for little memory


class Role(IntEnum):
    """Rights of a user; each role includes the rights of the roles before it."""

    VIEWER = 1
    OPERATOR = 2
    TECHNICIAN = 3


ROLES = tuple(role.name.lower() for role in Role)


class UsersError(SettingsError):
    """Error in reading or changing users; one line with the reason and what to do."""


@dataclass(frozen=True)
class User(Settings):
    """A user in the file."""

    name: str = parameter(text='of the login')
    role: Role = parameter(text='what the user may do', choices=ROLES)
    hash: str = parameter(text='argon2 hash of the password')

    def __post_init__(self) -> None:
        check_name(self.name)
        if not self.hash.startswith('$argon2'):
            raise UsersError('is no argon2 hash; run: checkweigher user password', 'hash')

    def has_password(self, password: str) -> bool:
        """Return whether this is the password of the user; it takes about 0.1 s."""
        try:
            return _HASHER.verify(self.hash, unicodedata.normalize('NFC', password))
        except (VerificationError, InvalidHashError):
            return False


def default_users() -> Path:
    """Return the default path of the users file, in the user's configuration folder."""
    given = Path(os.environ.get('XDG_CONFIG_HOME', ''))
    return (given if given.is_absolute() else Path.home() / '.config') / 'checkweigher/users'


def check_name(name: str) -> str:
    """Return the normalised name of a user, or raise UsersError."""
    name = unicodedata.normalize('NFC', name)
    if not re.fullmatch(r'[\w@-][\w.@-]{0,63}', name):
        rule = 'a name has up to 64 letters, digits, "_", "-", "@" and "." (not as the first)'
        raise UsersError(f'{one_line(name)!r}: {rule}')
    return name


def hash_password(name: str, password: str) -> str:
    """Return the hash of a new password, or raise UsersError if it is too easy to guess."""
    if not SHORTEST <= len(password) <= LONGEST:
        raise UsersError(
            f'the password of {name} has {len(password)}: it must have {SHORTEST} to {LONGEST} '
            'characters'
        )
    if password.casefold() == name.casefold():
        raise UsersError(f'the password of {name} is the name: choose another one')
    return _HASHER.hash(unicodedata.normalize('NFC', password))


# A user with an unknown password, so that a wrong name takes as much time as a wrong password.
NOBODY = User('nobody', Role.VIEWER, _HASHER.hash(os.urandom(16)))


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
        If the file does not exist, is not valid, or may be read by others.
    """
    return dict(_read(path).users or {})


def _read(path: Path) -> UsersFile:
    try:
        if os.stat(path).st_mode & _OF_OTHERS:
            raise UsersError(
                f'{path}: other users of this machine may use it; run: chmod 600 {path}'
            )
        with path.open('rb') as file:
            older = file.read(1) != b'{'
    except FileNotFoundError:
        raise UsersError(
            f'{path}: there is no such file; checkweigher user add NAME --role R makes it'
        ) from None
    except OSError as error:
        raise UsersError(f'{path}: cannot be read: {error}') from None
    return _older(path) if older else read_settings(path, UsersFile)


def _older(path: Path) -> UsersFile:
    """Return the users of format 1, which has a line NAME:ROLE:HASH for each."""
    users: dict[str, User] = {}
    for number, line in enumerate(path.read_bytes().decode(errors='replace').splitlines(), 1):
        if line and not line.startswith('#'):
            name, role, known = [*line.split(':'), '', ''][:3]
            try:
                if name in users:
                    raise UsersError(f'{name} is there twice; remove one of them')
                users[name] = settings_of(User, {'role': role, 'hash': known}, name)
            except SettingsError as error:
                raise UsersError(
                    f'{path}: line {number}: {error}; a line is NAME:ROLE:HASH'
                ) from None
    return UsersFile(users=users)


def write_users(path: Path, users: dict[str, User]) -> None:
    """Write a users file that only its owner may read, whole or not at all.

    Raises
    ------
    OutputError
        If it cannot be written; the previous file then stays.
    """
    known = _read(path) if path.exists() else UsersFile()
    try:
        write_settings(path, replace(known, users=users), _MODE)
    except OSError as error:
        raise output_error(path, error) from None


@contextmanager
def changing_users(path: Path) -> Iterator[None]:
    """Hold up other changes of a users file during a block, from reading to writing.

    Creates the folder of `default_users`. Raises OutputError if another folder does not exist.
    """
    try:
        if path == default_users():
            make_folder(path.parent, 0o700)
        with changing(path):
            yield
    except OSError as error:
        raise output_error(path, error) from None


@lru_cache(maxsize=1)
def _users_at(path: Path, *state: int) -> dict[str, User]:
    """Return the users in a file, cached while the file is unchanged."""
    return read_users(path)


class UserFile:
    """The users of a file that may change while the page is served.

    A file that cannot be read counts as empty, because its users may have been removed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def find(self, name: str) -> User | None:
        """Return the present user with a name, or None."""
        return self.now().get(unicodedata.normalize('NFC', name))

    def now(self) -> dict[str, User]:
        """Return the present users by name."""
        try:
            status = os.stat(self.path)
            state = status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode
            return _users_at(self.path, *state)
        except (OSError, SettingsError):
            return {}

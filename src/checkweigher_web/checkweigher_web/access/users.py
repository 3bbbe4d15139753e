# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Users of the page, with their roles and the argon2 hashes of their passwords."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
import hashlib
import os
from pathlib import Path
import re
import time
from typing import ClassVar
import unicodedata

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from argon2.low_level import Type, hash_secret_raw
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.printable import one_line
from checkweigher_core.records import utc
from checkweigher_core.settings_files import Settings, read_settings, settings_of, write_settings
from checkweigher_core.state_files import changing, make_folder
from checkweigher_core.whole_file import output_error
from checkweigher_validation.batch.signatures import RELEASE, Signature, public_hex
from checkweigher_validation.batch.signing import Signable, SigningError

SHORTEST, LONGEST = 8, 128  # minimum and maximum number of characters of a password
_MODE = 0o600
_OF_OTHERS = 0o077
_COST = 3, 65_536, 4  # iterations, memory in KiB and threads, as RFC 9106 advises for low memory
_HASHER = PasswordHasher()  # argon2id with the parameters of RFC 9106 for low memory


class Role(IntEnum):
    """Rights of a user. Each role includes the rights of the lower roles."""

    VIEWER = 1
    OPERATOR = 2
    TECHNICIAN = 3


ROLES = tuple(role.name.lower() for role in Role)


class UsersError(SettingsError):
    """Raised if a user, a password, a change of users or the users file is not valid.

    The message is one line.
    """


@dataclass(frozen=True)
class User(Settings):
    """User of the page."""

    name: str = parameter(text='name for the login')
    role: Role = parameter(text='role, which sets the allowed actions', choices=ROLES)
    hash: str = parameter(text='argon2 hash of the password')
    keys: str = parameter('', 'Ed25519 public keys of the user so far, hexadecimal, between spaces')

    def __post_init__(self) -> None:
        check_name(self.name)
        if not self.hash.startswith('$argon2'):
            raise UsersError('is not an argon2 hash; run: checkweigher user password', 'hash')

    def has_password(self, password: str) -> bool:
        """Return whether the password of the user is correct, which takes about 0.1 s."""
        try:
            return _HASHER.verify(self.hash, unicodedata.normalize('NFC', password))
        except (VerificationError, InvalidHashError):
            return False


def signing_key(path: Path, user: User, password: str) -> Ed25519PrivateKey:
    """Derive the private key for signatures of a user from the password, and return the key.

    The caller must have checked the password. A new password gives a new key. The first call for a
    key adds its public key to the users file. Raises `UsersError` if the user has been removed, and
    the errors of `read_users` and `write_users`.
    """
    salt = hashlib.sha256(f'checkweigher signature {user.hash}'.encode()).digest()[:16]
    secret = unicodedata.normalize('NFC', password).encode()
    seed = hash_secret_raw(secret, salt, *_COST, 32, Type.ID)
    key = Ed25519PrivateKey.from_private_bytes(seed)
    public = public_hex(key)
    with changing_users(path):
        users = read_users(path)
        if user.name not in users:
            raise UsersError(f'{path}: the user {user.name} has been removed')
        known = users[user.name].keys.split()
        if public not in known:
            own = replace(users[user.name], keys=' '.join([*known, public]))
            write_users(path, users | {user.name: own})
    return key


class WrongPasswordError(SigningError):
    """Raised if the password of a user is wrong."""


def least_role(meaning: str) -> Role:
    """Return the lowest role that may sign a record with a given meaning.

    The role is TECHNICIAN for the meaning RELEASE, and OPERATOR for any other meaning.
    """
    return Role.TECHNICIAN if meaning == RELEASE else Role.OPERATOR


def sign_by(path: Path, user: User, password: str, what: Signable, meaning: str) -> Signature:
    """Sign a record for a user who has entered the password again, and return the signature.

    Raises `SigningError` if the role is too low, the password is wrong, or another person must
    sign first. Raises the errors of `signing_key`.
    """
    if user.role < least_role(meaning):
        raise SigningError(f'{user.name}: a {meaning} needs a {least_role(meaning).name.lower()}')
    if not user.has_password(password):
        raise WrongPasswordError(f'{user.name}: the password is wrong; nothing was signed')
    key = signing_key(path, user, password)
    return what.signature(key, meaning, user.name, utc(time.time_ns()))


def default_users() -> Path:
    """Return the default path of the users file, ``$XDG_CONFIG_HOME/checkweigher/users``.

    The folder is ``~/.config/checkweigher`` if ``XDG_CONFIG_HOME`` is not an absolute path.
    """
    given = Path(os.environ.get('XDG_CONFIG_HOME', ''))
    return (given if given.is_absolute() else Path.home() / '.config') / 'checkweigher/users'


def account_name(given: str) -> str:
    """Return a typed user name, normalized to Unicode NFC and cut to 64 characters."""
    return unicodedata.normalize('NFC', given)[:64]


def check_name(name: str) -> str:
    """Return a user name, normalized to Unicode NFC. Raises `UsersError` for an invalid name."""
    name = unicodedata.normalize('NFC', name)
    if not re.fullmatch(r'[\w@-][\w.@-]{0,63}', name):
        rule = 'a name has up to 64 letters, digits, "_", "-", "@" and "." (not as the first)'
        raise UsersError(f'{one_line(name)!r}: {rule}')
    return name


def hash_password(name: str, password: str) -> str:
    """Return the argon2 hash of a new password.

    Raises `UsersError` if the number of characters is not in `SHORTEST`..`LONGEST`, or if the
    password is the user name, regardless of case.
    """
    if not SHORTEST <= len(password) <= LONGEST:
        raise UsersError(
            f'the password of {name} has {len(password)} characters: it must have {SHORTEST} to '
            f'{LONGEST}'
        )
    if password.casefold() == name.casefold():
        raise UsersError(f'the password of {name} is the user name: choose another one')
    return _HASHER.hash(unicodedata.normalize('NFC', password))


# User with a random password of 16 bytes, which was not stored. Checking a password for this user
# takes as much time as for any other user, so that the time does not reveal which names exist. The
# hash is a constant, because its computation would delay each start of the page by 0.3 s.
NOBODY = User(
    'nobody',
    Role.VIEWER,
    '$argon2id$v=19$m=65536,t=3,p=4$PHtwuwyU7NzfaTUt3k967A'
    '$Je2O8QikZWspJruMiE528ZMEkNJy8PeY6FojV+fMIig',
)


@dataclass(frozen=True)
class UsersFile(Settings):
    """Content of the users file."""

    format: ClassVar[int] = 2
    users: Mapping[str, User] | None = parameter(None, 'users by name')


def read_users(path: Path) -> dict[str, User]:
    """Return the users of a file by name.

    Raises `SettingsError` if the file does not exist, cannot be read, is not valid, or is
    accessible to other users of this machine.
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
            f'{path}: there is no such file; run: checkweigher user add NAME --role R'
        ) from None
    except OSError as error:
        raise UsersError(f'{path}: cannot be read: {error}') from None
    return _older(path) if older else read_settings(path, UsersFile)


def _older(path: Path) -> UsersFile:
    """Return the content of a file of format 1, which has a line NAME:ROLE:HASH for each user.

    Raises `UsersError` with the number of the line if a line is not valid.
    """
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
    """Write users to a users file, which only its owner may read and write.

    Raises `OutputError` if the file cannot be written, and `SettingsError` if the previous file is
    not valid. An error does not change the previous file.
    """
    known = _read(path) if path.exists() else UsersFile()
    try:
        write_settings(path, replace(known, users=users), _MODE)
    except OSError as error:
        raise output_error(path, error) from None


@contextmanager
def changing_users(path: Path) -> Iterator[None]:
    """Lock a users file while the body of the ``with`` statement reads and writes it.

    Creates the folder of the file if it is missing and `path` is `default_users()`. Raises
    `OutputError` if the folder of any other `path` is missing, if the folder cannot be created or
    locked, or if the body raises OSError.
    """
    try:
        if path == default_users():
            make_folder(path.parent, 0o700)
        with changing(path):
            yield
    except OSError as error:
        raise output_error(path, error) from None


def add_first_user(path: Path, name: str, password: str) -> User:
    """Write a users file with its first user, who is a technician, and return this user.

    Raises `UsersError` if there are users already, or if the name or password is not allowed,
    `SettingsError` if the file is not valid, and `OutputError` if it cannot be written.
    """
    user = User(check_name(name), Role.TECHNICIAN, hash_password(name, password))
    with changing_users(path):
        if path.exists() and read_users(path):
            raise UsersError('there is a user already: log in')
        write_users(path, {user.name: user})
    return user


def check_user(path: Path, name: str, *, exists: bool = True) -> str:
    """Check that a user exists, or does not exist if `exists` is false, and return the name.

    The returned name is in Unicode form NFC. Raises `UsersError` if the check fails or the name is
    not valid, and `SettingsError` if the users file is not valid.
    """
    name = check_name(name)
    _of_change(path, name, exists=exists)
    return name


def _of_change(path: Path, name: str, *, exists: bool) -> dict[str, User]:
    users = read_users(path) if exists or path.exists() else {}
    if (name in users) != exists:
        raise UsersError(f'user {name} {"does not exist" if exists else "exists already"}')
    return users


def add_user(path: Path, name: str, role: Role, password: str) -> None:
    """Add a user to a users file, which is created if it does not exist.

    Raises the errors of `check_user`, `hash_password` and `write_users`.
    """
    name = check_user(path, name, exists=False)
    user = User(name, role, hash_password(name, password))
    with changing_users(path):
        write_users(path, _of_change(path, name, exists=False) | {name: user})


def change_user(path: Path, name: str, *, role: Role | None = None, password: str = '') -> None:
    """Change the role of a user, or the password if `role` is None.

    Raises the errors of `check_user`, `hash_password` and `write_users`.
    """
    name = check_user(path, name)
    hashed = hash_password(name, password) if role is None else ''
    with changing_users(path):
        users = _of_change(path, name, exists=True)
        user = users[name]
        users[name] = replace(user, role=role or user.role, hash=hashed or user.hash)
        write_users(path, users)


def remove_user(path: Path, name: str) -> None:
    """Remove a user from a users file. Raises the errors of `check_user` and `write_users`."""
    name = check_user(path, name)
    with changing_users(path):
        users = _of_change(path, name, exists=True)
        del users[name]
        write_users(path, users)


@lru_cache(maxsize=1)
def _users_at(path: Path, *state: int) -> dict[str, User]:
    """Return the users of a file, and cache the latest result.

    `state` contains values of `os.stat` that change with the file, so that a changed file is read
    again.
    """
    return read_users(path)


class UserFile:
    """Users of a file that may change while the page is served.

    A file that cannot be read or is not valid counts as a file without users, which ends all
    sessions.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def find(self, name: str) -> User | None:
        """Return the user whose name is `name`, or None if the file does not contain the user."""
        return self.now().get(unicodedata.normalize('NFC', name))

    def now(self) -> dict[str, User]:
        """Return the users that the file contains at present, by name.

        Returns an empty dict if the file does not exist, cannot be read, or is not valid.
        """
        try:
            status = os.stat(self.path)
            state = status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode
            return _users_at(self.path, *state)
        except (OSError, SettingsError):
            return {}

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Add, list, change and remove the users of the page."""

import argparse
from dataclasses import replace
from getpass import getpass
from pathlib import Path
import sys

from checkweigher_bringup.errors import UserError

_ROLES = 'viewer', 'operator', 'technician'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `user`."""
    add = parser.add_argument
    add('action', choices=('add', 'list', 'password', 'remove'),
        help='the password is typed twice, or is a line of the standard input')  # fmt: skip
    add('name', nargs='?', metavar='NAME', help='of the user; not with list')
    add('--role', choices=_ROLES,
        help='viewer: sees; operator: products, batches, zero, start and stop; technician: '
        'calibration, tuning and limits as well')  # fmt: skip
    add('--users', type=Path, metavar='FILE',
        help='default checkweigher/users in $XDG_CONFIG_HOME or ~/.config')  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Change the file of users, or show it."""
    from checkweigher_web.access.users import (
        Role,
        User,
        check_name,
        default_users,
        hash_password,
        read_users,
        write_users,
    )

    path = arguments.users or default_users()
    if (arguments.name is None) != (arguments.action == 'list'):
        raise UserError(f'{arguments.action}: must have a NAME, and only list has none')
    if (arguments.role is None) != (arguments.action != 'add'):
        raise UserError(f'{arguments.action}: must have a --role, and only add has one')
    users = read_users(path) if path.exists() or arguments.action != 'add' else {}
    if arguments.action == 'list':
        for user in users.values():
            print(f'{user.name}  {user.role.name.lower()}')
        return 0
    name = check_name(arguments.name)
    if (name in users) != (arguments.action != 'add'):
        known = 'is there already' if name in users else 'is not there'
        raise UserError(f'{path}: user {name} {known}; checkweigher user list shows all')
    if arguments.action == 'remove':
        del users[name]
    else:
        known = hash_password(name, _password(name))
        old = users.get(name)
        users[name] = (
            replace(old, hash=known) if old else User(name, Role[arguments.role.upper()], known)
        )
    write_users(path, users)
    print(f'{path}: {name} {_DONE[arguments.action]}')
    return 0


_DONE = {'add': 'added', 'password': 'has a new password', 'remove': 'removed'}


def _password(name: str) -> str:
    """Return a password typed twice without echo, or a line of an input that is no terminal."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip('\r\n')
    password = getpass(f'Password of {name}: ')
    if getpass('The same again: ') != password:
        raise UserError(f'the two passwords of {name} differ; nothing was changed')
    return password

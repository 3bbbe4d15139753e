# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Add, list, change and remove the users of the page.

checkweigher user add anna --role operator
"""

import argparse
from dataclasses import replace
from getpass import getpass
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_web.access.users import User

_ROLES = 'viewer', 'operator', 'technician'
_DONE = {'add': 'added', 'password': 'has a new password', 'remove': 'removed'}
_PASSWORD = 'the password is typed twice, or is a line of the standard input'
OPTIONS = (
    ('action', ('add', 'list', 'password', 'remove'), _PASSWORD),
    ('name NAME', str, 'of the user; not with list', {'nargs': '?'}),
    (
        '--role',
        _ROLES,
        'viewer: sees; operator: products, batches, zero, start and stop; technician: '
        'calibration, tuning and limits as well',
    ),
    ('--users FILE', Path, 'default checkweigher/users in $XDG_CONFIG_HOME or ~/.config'),
)


def run(arguments: argparse.Namespace) -> int:
    """Change the file of the users, or list its users."""
    from checkweigher_web.access import users as accounts

    path = arguments.users or accounts.default_users()
    action, name = arguments.action, arguments.name
    if (name is None) != (action == 'list'):
        raise UserError(f'{action}: needs a NAME, except for list')
    if (arguments.role is None) != (action != 'add'):
        raise UserError(f'{action}: must have a --role if it is add, and none otherwise')
    if action == 'list':
        for user in accounts.read_users(path).values():
            print(f'{user.name}  {user.role.name.lower()}')
        return 0
    name = accounts.check_name(name)
    _users(path, action, name)  # raises an error before the user types a password
    password = '' if action == 'remove' else accounts.hash_password(name, _password(name))
    with accounts.changing_users(path):
        users = _users(path, action, name)
        if action == 'remove':
            del users[name]
        elif action == 'add':
            users[name] = accounts.User(name, accounts.Role[arguments.role.upper()], password)
        else:
            users[name] = replace(users[name], hash=password)
        accounts.write_users(path, users)
    print(f'{path}: {name} {_DONE[action]}')
    return 0


def _users(path: Path, action: str, name: str) -> 'dict[str, User]':
    """Return the users in a file, or raise `UserError` if the action cannot be done for `name`."""
    from checkweigher_web.access.users import read_users

    users = read_users(path) if path.exists() or action != 'add' else {}
    if (name in users) != (action != 'add'):
        known = 'is there already' if name in users else 'is not there'
        raise UserError(f'{path}: user {name} {known}; checkweigher user list shows all')
    return users


def _password(name: str) -> str:
    """Return a password that is typed twice, or the first line of an input from a file or pipe."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip('\r\n')
    password = getpass(f'Password of {name}: ')
    if getpass('The same again: ') != password:
        raise UserError(f'the two passwords of {name} differ; nothing was changed')
    return password

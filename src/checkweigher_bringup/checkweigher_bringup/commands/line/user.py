# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Add, list, change and remove the users of the page.

Examples
--------
checkweigher user add anna --role operator
"""

import argparse
from getpass import getpass
import sys

from checkweigher_bringup.commands import USERS
from checkweigher_bringup.errors import UserError

_ROLES = 'viewer', 'operator', 'technician'
_DONE = {'add': 'added', 'password': 'has a new password', 'remove': 'removed'}
_PASSWORD = 'add and password ask for the password twice, or read one line from a pipe or file'
OPTIONS = (
    ('action', ('add', 'list', 'password', 'remove'), _PASSWORD),
    ('name NAME', str, 'name of the user; not with list', {'nargs': '?'}),
    (
        '--role',
        _ROLES,
        'role of the new user: a viewer views the page; an operator also selects products, begins '
        'batches, sets the zero, starts and stops the line; a technician also sets limits, '
        'calibrates, tunes and verifies',
    ),
    USERS,
)


def run(arguments: argparse.Namespace) -> int:
    """Change the users file, or print the name and the role of each user in the file.

    Raises `UserError` if NAME or `--role` is missing or not allowed for the action, or if the two
    typed passwords differ. Raises `UsersError` or `OutputError` if the users file cannot be read or
    changed, or if the name or the password is not allowed.
    """
    from checkweigher_web.access import users as accounts

    path = arguments.users or accounts.default_users()
    action, name = arguments.action, arguments.name
    for option, value, is_needed in (
        ('NAME', name, action != 'list'),
        ('--role', arguments.role, action == 'add'),
    ):
        if (value is not None) != is_needed:
            advice = 'is missing: add it' if is_needed else 'is not used here: leave it out'
            raise UserError(f'{action}: {option} {advice}')
    if action == 'list':
        for user in accounts.read_users(path).values():
            print(f'{user.name}  {user.role.name.lower()}')
        return 0
    # Check the name before the user has to type a password.
    name = accounts.check_user(path, name, exists=action != 'add')
    if action == 'remove':
        accounts.remove_user(path, name)
    elif action == 'add':
        accounts.add_user(path, name, accounts.Role[arguments.role.upper()], _password(name))
    else:
        accounts.change_user(path, name, password=_password(name))
    print(f'{path}: {name} {_DONE[action]}')
    return 0


def _password(name: str) -> str:
    """Return the new password of a user from the standard input.

    At a terminal, the user types the password twice. Otherwise, the password is the next line of
    the standard input.

    Raises `UserError` if the two typed passwords differ.
    """
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip('\r\n')
    password = getpass(f'Password of {name}: ')
    if getpass('Repeat the password: ') != password:
        raise UserError(f'the two passwords of {name} differ; nothing was changed')
    return password

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sign the record of a batch: review, approval or release.

checkweigher sign /var/lib/checkweigher/lane1/batches/L2417.jsonl --meaning review --who anna
"""

import argparse
from dataclasses import asdict
from pathlib import Path
import time
from typing import TYPE_CHECKING, Any

from checkweigher_bringup.commands import NAMESPACE, REQUIRED, USERS
from checkweigher_bringup.errors import LineError, UserError

if TYPE_CHECKING:
    from checkweigher_validation.batch.batch import Batch
    from checkweigher_web.access.users import User

OPTIONS = (
    ('record RECORD', Path, 'record of a batch that has ended'),
    ('--meaning', ('review', 'approval', 'release'), 'what the signature means', REQUIRED),
    ('--who NAME', str, 'user of the page who signs, and must type the password', REQUIRED),
    USERS,
    ('--log LOG', Path, 'audit log; default: audit.log in the folder of the machine'),
    NAMESPACE,
)


def run(arguments: argparse.Namespace) -> int:
    """Check record and password, and write the signature to the audit log."""
    from checkweigher_bringup.batch_report import own_log, read_recorded
    from checkweigher_core.changes import PERSON, SIGNATURE
    from checkweigher_core.records import utc
    from checkweigher_validation.batch.signatures import RELEASE, lacking, sign
    from checkweigher_web.access.users import default_users, signing_key

    batch = read_recorded(arguments.record, arguments.log)
    log = arguments.log or own_log(arguments.record)
    users, now = arguments.users or default_users(), utc(time.time_ns())
    _check_batch(batch)
    user, password = _login(users, arguments.who, arguments.meaning)
    if not user.has_password(password):
        refused = f'{arguments.meaning} of batch {batch.name}: refused: wrong password'
        _write(log, arguments.namespace, PERSON, user.name, refused, user.name)
        raise LineError(f'{user.name}: the password is wrong; nothing was signed')
    key = signing_key(users, user, password)
    signature = sign(key, batch.name, arguments.meaning, user.name, now, batch.sha256)
    lacks = lacking((*batch.signatures, signature), batch.persons)
    if arguments.meaning == RELEASE and lacks:
        raise LineError(f'batch {batch.name} cannot be released: {lacks}')
    _write(log, arguments.namespace, SIGNATURE, batch.name, asdict(signature), user.name)
    print(f'{arguments.meaning} of batch {batch.name} signed by {user.name}, {now}')
    print(f'the record has the SHA-256 {batch.sha256}')
    return 0


def _check_batch(batch: 'Batch') -> None:
    """Raise `LineError` unless a batch has ended and its record can be trusted."""
    if not batch.end:
        raise LineError(f'batch {batch.name} has not ended yet')
    if batch.faults:
        raise LineError(f'batch {batch.name} cannot be signed: {batch.faults[0]}')


def _login(path: Path, name: str, meaning: str) -> tuple['User', str]:
    """Return the user who signs, and the password that was typed. Raises `UserError`."""
    from getpass import getpass
    import sys

    from checkweigher_validation.batch.signatures import RELEASE
    from checkweigher_web.access.users import Role, read_users

    user = read_users(path).get(name)
    least = Role.TECHNICIAN if meaning == RELEASE else Role.OPERATOR
    if user is None or user.role < least:
        raise UserError(f'{path}: no user {name} with at least the role {least.name.lower()}')
    if sys.stdin.isatty():
        return user, getpass(f'Password of {name}, for the {meaning}: ')
    return user, sys.stdin.readline().rstrip('\r\n')


def _write(log: Path, lane: str, kind: str, subject: str, value: Any, who: str) -> None:
    """Write an entry to a log, through the running line if the line has opened the log."""
    from checkweigher_core.records import utc
    from checkweigher_production.audit_log import AuditLog, LogInUseError
    from checkweigher_production.audit_trail import CLAIMED

    try:
        with AuditLog(log) as opened:
            now = utc(time.time_ns())
            opened.append(now, 'sign', kind, subject, None, value, f'{CLAIMED}{who}')
    except LogInUseError:
        _write_by_line(lane, kind, subject, value, who)


def _write_by_line(lane: str, kind: str, subject: str, value: Any, who: str) -> None:
    from checkweigher_bringup.commissioning.service_call import node_that_verifies, write_to_log
    from checkweigher_bringup.settings import check_namespace

    with node_that_verifies(check_namespace(lane)) as node:
        write_to_log(node, kind, subject, value, who)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sign a batch, a verification, or a change of limits or of a recipe.

Examples
--------
checkweigher sign /var/lib/checkweigher/lane1/batches/L2417.jsonl --meaning review --who anna
checkweigher sign /var/lib/checkweigher/lane1/audit.log --entry 27 --meaning approval --who anna
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import NAMESPACE, REQUIRED, USERS
from checkweigher_bringup.errors import LineError, UserError

if TYPE_CHECKING:
    from checkweigher_validation.batch.signing import Signable
    from checkweigher_web.access.users import User

OPTIONS = (
    (
        'what WHAT',
        Path,
        'record of a batch that has ended, folder of a verification, or audit log with --entry',
    ),
    ('--entry N', int, 'number of the audit log entry to sign: a change of limits or of a recipe'),
    ('--meaning', ('review', 'approval', 'release'), 'meaning of the signature', REQUIRED),
    ('--who NAME', str, 'user of the page who signs, and must type the password', REQUIRED),
    USERS,
    ('--log LOG', Path, 'audit log; default: audit.log in the folder of the machine'),
    NAMESPACE,
)


def run(arguments: argparse.Namespace) -> int:
    """Check the password and the document, and write the signature to the audit log.

    If the password is wrong, the refusal is written to the audit log, and `LineError` is raised.

    Raises `LineError` if the signature is refused, and `UserError` if the log has no entry on the
    document, or if the user does not exist or may not sign.
    """
    from checkweigher_bringup.commands.production import write_claim
    from checkweigher_core.changes import PERSON, SIGNATURE
    from checkweigher_validation.batch.signing import SigningError
    from checkweigher_web.access.users import WrongPasswordError, default_users, sign_by

    log, find = _found(arguments)
    users = arguments.users or default_users()
    try:
        what = find()
        user, password = _login(users, arguments.who, arguments.meaning)
        made = sign_by(users, user, password, what, arguments.meaning)
    except WrongPasswordError as error:
        refused = f'{arguments.meaning} of {what.title}: refused: wrong password'
        write_claim(log, arguments.namespace, PERSON, user.name, refused, user.name)
        raise LineError(str(error)) from None
    except SigningError as error:
        raise LineError(str(error)) from None
    write_claim(log, arguments.namespace, SIGNATURE, what.subject, made.value, user.name)
    print(f'{made.meaning} of {what.title} signed by {user.name}, {made.time}')
    print(f'what was signed has the SHA-256 {made.sha256}')
    return 0


def _found(arguments: argparse.Namespace) -> tuple[Path, Callable[[], 'Signable']]:
    """Return the path of the audit log, and a function that reads the document to be signed.

    Raises `UserError` if the log has no entry on the verification, or no entry with the given
    number. For a batch record, only the returned function compares the record with the log.
    """
    from functools import partial

    from checkweigher_core.changes import VERIFICATION
    from checkweigher_production.audit_chain import LOG_FILE, read_chain
    from checkweigher_production.batch_record import SUFFIX
    from checkweigher_validation.batch.signing import signable_batch, signable_entry

    what: Path = arguments.what
    is_log = arguments.entry is not None
    if is_log and arguments.log:
        raise UserError('--entry: signs an entry of the audit log WHAT, so leave out --log')
    log = arguments.log or (what if is_log else what.resolve().parents[1] / LOG_FILE)
    if not is_log and what.suffix == SUFFIX:
        return log, partial(signable_batch, what, arguments.log)
    chain, made = read_chain(log), (VERIFICATION, what.resolve().name)
    if is_log:
        entries = [e for e in chain.logs[-1][1].entries if e.sequence == arguments.entry]
    else:
        entries = [e for e in chain.entries if (e.kind, e.subject) == made]
    if not entries:
        raise UserError(f'{log}: has no entry {arguments.entry if is_log else " ".join(made)}')
    return log, partial(signable_entry, log, entries[-1].hash)


def _login(path: Path, name: str, meaning: str) -> tuple['User', str]:
    """Return the user who signs, and the password that was typed.

    The password is not checked here.

    Raises `UserError` if there is no such user, or if the role of the user does not allow the
    signature.
    """
    from getpass import getpass
    import sys

    from checkweigher_web.access.users import least_role, read_users

    user, least = read_users(path).get(name), least_role(meaning)
    if user is None or user.role < least:
        raise UserError(f'{path}: no user {name} with at least the role {least.name.lower()}')
    if sys.stdin.isatty():
        return user, getpass(f'Password of {name}, for the {meaning}: ')
    return user, sys.stdin.readline().rstrip('\r\n')

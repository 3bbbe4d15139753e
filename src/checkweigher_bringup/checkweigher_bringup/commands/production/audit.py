# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify the hash chain of an audit log, and show its entries.

Examples
--------
checkweigher audit /var/log/checkweigher/lane1.log
checkweigher audit --all /var/lib/checkweigher/lane1
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict
import json
from pathlib import Path
import re
import sys
import time
from typing import TYPE_CHECKING, Any

from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_production.audit_log import Entry, Verification
    from checkweigher_production.audit_seal import Seal

_WIDEST = 40  # largest number of characters of a value on a terminal
_PATIENCE = 2.0  # time in s after which a folder with faults is checked a second time

OPTIONS = (
    ('log LOG', Path, 'audit log, with LOG.head in the same folder', {'nargs': '?'}),
    (
        '--all FOLDER',
        Path,
        'check the audit logs in the folder of a machine, and compare its records, reports and '
        'verifications with them',
    ),
    ('--users FILE', Path, 'with --all: file of the users whose keys the signatures must have'),
    ('--hash HASH', str, 'hash of an entry that was noted elsewhere and must be in the log'),
    ('--json', bool, 'print JSON instead of a table'),
    ('--seal KEY', Path, 'seal the log: sign its last hash with this Ed25519 private key (PEM)'),
    ('--trust PUBLIC', Path, 'Ed25519 public key (PEM) to verify the seals of the log'),
    ('--seals FILE', Path, 'file of the seals; default LOG.seals'),
)


def run(arguments: argparse.Namespace) -> int:
    """Print the changes in a log or, with `--all`, the faults in the folder of a machine.

    With `--seal`, also seal the log if it has no fault.

    Returns 1 if there is a fault, such as a broken chain or a contradiction to the seals, otherwise
    0.
    """
    if (arguments.log is None) == (arguments.all is None):
        raise UserError('give a LOG, or --all FOLDER')
    if arguments.all is not None:
        if arguments.hash or arguments.json or arguments.seal:
            raise UserError('--hash, --json and --seal are for one LOG, not with --all')
        return _check_folder(arguments)
    return _check_log(arguments)


def _check_log(arguments: argparse.Namespace) -> int:
    """Print the changes in one log. Return 1 if there is a fault, otherwise 0.

    With `--seal`, also seal the log if it has no fault.
    """
    from checkweigher_production.audit_log import read_log
    from checkweigher_production.audit_seal import hold_to_seals, public_key, seals_path

    found = read_log(arguments.log, _noted_hash(arguments.hash))
    seals_file = arguments.seals or seals_path(arguments.log)
    seals: Sequence[Seal] = ()
    if found.whole and arguments.trust:
        seals, found = hold_to_seals(found, seals_file, public_key(arguments.trust))
    if arguments.json:
        print(json.dumps(_as_json(found, seals), indent=2))
    else:
        print('\n'.join(_lines(found, seals)))
    if found.whole and arguments.seal:
        seal = _seal(arguments, found, seals_file)
        print(f'sealed: seal {seal.number}, through entry {seal.entries}', file=sys.stderr)
    return 0 if found.whole else 1


def _lines(found: 'Verification', seals: 'Sequence[Seal]') -> Iterator[str]:
    from checkweigher_production.audit_seal import sealing
    from checkweigher_production.audit_words import conclusion, steps_back

    # Values are shortened only on a terminal, so that a file or a pipe gets the whole values.
    yield from _table(found.entries, _WIDEST if sys.stdout.isatty() else None)
    yield from steps_back(found.entries)
    yield conclusion(found)
    if seals and found.whole:
        yield sealing(seals, found.entries)


def _check_folder(arguments: argparse.Namespace) -> int:
    """Print the summary and the faults of a machine folder. Return 1 if there is a fault, else 0.

    If there are faults, the folder is checked a second time, after `_PATIENCE` s.
    """
    from checkweigher_bringup.audit_folder import faults_in, summary
    from checkweigher_bringup.batch_report import signers_of
    from checkweigher_production.audit_chain import LOG_FILE, read_chain
    from checkweigher_production.audit_seal import hold_to_seals, public_key, sealing, seals_path

    folder = arguments.all
    signers = signers_of(arguments.users) if arguments.users else None
    chain = read_chain(folder / LOG_FILE)
    faults = list(faults_in(folder, chain, signers))
    if faults:
        # A running line may have written a file but not yet the entry on this file, so check again.
        time.sleep(_PATIENCE)
        chain = read_chain(folder / LOG_FILE)
        faults = list(faults_in(folder, chain, signers))
    lines = list(summary(folder, chain))
    log, found = chain.logs[-1]
    if arguments.trust and found.whole:
        path = arguments.seals or seals_path(log)
        seals, found = hold_to_seals(found, path, public_key(arguments.trust))
        if found.whole:
            lines.append(sealing(seals, found.entries))
        else:
            faults.append(found.reason)
    print('\n'.join([*lines, *(f'FAULT: {each}' for each in faults)]))
    print(f'{folder}: {"NOT as it was written" if faults else "all is as it was written"}')
    return int(bool(faults))


def _noted_hash(given: str | None) -> str:
    """Return the hash of the option `--hash` in lower case, or '' if the option was not given.

    Raises `UserError` if the option is not a valid hash.
    """
    if given is None:
        return ''
    noted = given.strip().lower()
    # An unset shell variable gives an empty text, which must not disable the check.
    if not re.fullmatch('[0-9a-f]{64}', noted):
        raise UserError(f'--hash {given!r}: is not the hash of an entry (64 hexadecimal digits)')
    return noted


def _seal(arguments: argparse.Namespace, found: 'Verification', seals_file: Path) -> 'Seal':
    from checkweigher_production.audit_log import AuditError
    from checkweigher_production.audit_seal import add_seal, private_key

    if arguments.seal.resolve().parent == arguments.log.resolve().parent:
        raise AuditError(
            f'{arguments.seal}: the key is in the folder of the log, where a forger of the log '
            'could read it; move it to a place that only you can read'
        )
    return add_seal(seals_file, arguments.log, found.entries, private_key(arguments.seal))


def _as_json(found: 'Verification', seals: 'Sequence[Seal]') -> dict[str, Any]:
    """Return the entries before the first fault of a log, the fault, and the seals as JSON values.

    The fault consists of the kind of the problem, the reason, and the number of the faulty line if
    it is known. Values that do not exist are None.
    """
    return {
        'whole': found.whole,
        'bad_line': found.bad_line or None,
        'problem': found.problem or None,
        'reason': found.reason or None,
        'torn_bytes': len(found.torn),
        'entries': [asdict(entry) for entry in found.entries],
        'seals': [asdict(seal) for seal in seals],
    }


def _table(entries: 'Sequence[Entry]', widest: int | None) -> Iterator[str]:
    """Yield the lines of a table of entries, with at most `widest` characters of each value.

    If `widest` is None, the values are not shortened.
    """
    from checkweigher_production.audit_words import changes, shortened

    yield f'{"entry":>5}  {"time, UTC":32}  {"who":16}  {"kind":11}  what: old -> new, why'
    for entry in entries:
        for what, old, new in changes(entry):
            time, kind = shortened(entry.time), shortened(entry.kind)
            begin = f'{entry.sequence:>5}  {time:32}  {shortened(entry.who):16}'
            values = f'{shortened(old, widest)} -> {shortened(new, widest)}'
            change = f'{shortened(what, None)}: {values}'
            why = f', {shortened(entry.why, None)}' if entry.why else ''
            yield f'{begin}  {kind:11}  {change}{why}'

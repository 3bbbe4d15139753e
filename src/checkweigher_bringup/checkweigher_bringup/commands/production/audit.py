# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify an audit log, show what was changed, and seal the log with a key."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
import json
from pathlib import Path
import re
import sys
from typing import TYPE_CHECKING, Any

from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_dsp.production.audit_log import Entry, Verification
    from checkweigher_dsp.production.audit_seal import Seal

_WIDEST = 40  # characters of a value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `audit`."""
    add = parser.add_argument
    add('log', type=Path, metavar='LOG', help='audit log; LOG.head is beside it')
    add('--hash', metavar='HASH',
        help='an entry with this hash, noted elsewhere, has to be there')  # fmt: skip
    add('--json', action='store_true', help='print JSON instead of a table')
    add('--seal', type=Path, metavar='KEY',
        help='seal the log: sign its last hash with this Ed25519 private key (PEM)')  # fmt: skip
    add('--trust', type=Path, metavar='PUBLIC',
        help='hold the log against its seals, by this Ed25519 public key (PEM)')  # fmt: skip
    add('--seals', type=Path, metavar='FILE', help='file of the seals (default: LOG.seals)')


def run(arguments: argparse.Namespace) -> int:
    """Show the changes; 1 if the chain is broken, or is not the one that was sealed."""
    from checkweigher_dsp.production.audit_log import read_log

    found = read_log(arguments.log, _noted_hash(arguments.hash))
    seals: Sequence[Seal] = ()
    if found.whole and arguments.trust:
        seals, found = _verify_seals(arguments, found)
    if arguments.json:
        print(json.dumps(_as_json(found, seals), indent=2))
    else:
        print('\n'.join([*_table(found.entries), _conclusion(found)]))
        if seals and found.whole:
            print(_sealed(seals, found.entries))
    if found.whole and arguments.seal:
        seal = _seal(arguments, found)
        print(f'sealed: seal {seal.number}, through entry {seal.entries}', file=sys.stderr)
    return 0 if found.whole else 1


def _noted_hash(given: str | None) -> str:
    """Return the hash that has to be there, empty if none was given; `UserError` if it is none."""
    if given is None:
        return ''
    noted = given.strip().lower()
    # That of a variable which was not set would be held to nothing.
    if not re.fullmatch('[0-9a-f]{64}', noted):
        raise UserError(f'--hash {given!r}: is no hash of an entry, 64 hexadecimal digits')
    return noted


def _seals_file(arguments: argparse.Namespace) -> Path:
    log: Path = arguments.log
    return arguments.seals or log.with_name(log.name + '.seals')


def _verify_seals(
    arguments: argparse.Namespace, found: 'Verification'
) -> 'tuple[Sequence[Seal], Verification]':
    """Return the seals of a log, and the log as broken where they say so."""
    from checkweigher_dsp.production.audit_log import AuditError
    from checkweigher_dsp.production.audit_seal import broken_seal, public_key, read_seals

    key, path = public_key(arguments.trust), _seals_file(arguments)
    if not path.exists():
        raise AuditError(f'{path}: there are no seals; name their file by --seals')
    try:
        seals = read_seals(path, key)
    except AuditError as error:
        return (), replace(found, problem='seal', reason=str(error))
    broken = broken_seal(seals, found.entries)
    return seals, replace(found, problem='seal' if broken else '', reason=broken)


def _seal(arguments: argparse.Namespace, found: 'Verification') -> 'Seal':
    from checkweigher_dsp.production.audit_log import AuditError
    from checkweigher_dsp.production.audit_seal import add_seal, private_key

    if arguments.seal.resolve().parent == arguments.log.resolve().parent:
        raise AuditError(
            f'{arguments.seal}: lies in the folder of the log: who can write the one could read '
            'the other; move it where only the one who seals can read it'
        )
    key = private_key(arguments.seal)
    return add_seal(_seals_file(arguments), arguments.log, found.entries, key)


def _as_json(found: 'Verification', seals: 'Sequence[Seal]') -> dict[str, Any]:
    """Return the entries before the first bad line, what is wrong with that line, and the seals."""
    return {
        'whole': found.whole,
        'bad_line': found.bad_line or None,
        'problem': found.problem or None,
        'reason': found.reason or None,
        'torn_bytes': len(found.torn),
        'unended': found.unended,
        'entries': [asdict(entry) for entry in found.entries],
        'seals': [asdict(seal) for seal in seals],
    }


def _table(entries: 'Sequence[Entry]') -> Iterator[str]:
    """Yield a line for each value that was changed."""
    yield f'{"entry":>5}  {"time":26}  {"who":16}  {"kind":11}  what: old -> new, why'
    for entry in entries:
        for what, old, new in _changes(entry):
            begin = f'{entry.sequence:>5}  {entry.time[:26]:26}  {_short(entry.who):16}'
            why = f', {_short(entry.why)}' if entry.why else ''
            yield f'{begin}  {entry.kind:11}  {what}: {_short(old)} -> {_short(new)}{why}'


def _conclusion(found: 'Verification') -> str:
    """Return the last line: whether the chain is whole, or where it is broken."""
    count = len(found.entries)
    if not found.whole and not found.bad_line:
        return f'BROKEN: {found.reason}'
    if not found.whole:
        return f'BROKEN: line {found.bad_line}: {found.problem}: {found.reason}'
    last = f', the last one has the hash {found.entries[-1].hash}' if count else ''
    torn = '; a last one was cut off by power loss' if found.torn else ''
    if found.unended:
        torn = '; the end of its line was cut off by power loss'
    return f'the chain is whole: {count} entries{last}{torn}'


def _sealed(seals: 'Sequence[Seal]', entries: 'Sequence[Entry]') -> str:
    last = seals[-1]
    return (
        f'it is the one that was sealed: {last.number} times, the last time at {last.time} through '
        f'entry {last.entries}; entries since then: {len(entries) - last.entries}'
    )


def _changes(entry: 'Entry') -> list[tuple[str, Any, Any]]:
    """Return name, old and new value of each change; only the number of values that are all new."""
    old, new = entry.old, entry.new
    if not isinstance(new, dict):
        return [(entry.subject, old, new)]
    if not old:
        return [(entry.subject, None, f'{len(new)} values')]
    names = [name for name in new if new[name] != old.get(name)]
    return [(f'{entry.subject}.{name}', old.get(name), new[name]) for name in names]


def _short(value: Any) -> str:
    text = '-' if value is None else value if isinstance(value, str) else json.dumps(value)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= _WIDEST else text[: _WIDEST - 3] + '...'

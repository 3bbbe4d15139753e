# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verify an audit log and show what was changed."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from checkweigher_dsp.production.audit_log import Entry, Verification

_WIDEST = 40  # characters of a value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `audit`."""
    add = parser.add_argument
    add('log', type=Path, metavar='LOG', help='audit log; LOG.head is beside it')
    add('--hash', default='', metavar='HASH',
        help='an entry with this hash, noted elsewhere, has to be there')  # fmt: skip
    add('--json', action='store_true', help='print JSON instead of a table')


def run(arguments: argparse.Namespace) -> int:
    """Show the changes; 1 if the chain is broken."""
    from checkweigher_dsp.production.audit_log import read_log

    found = read_log(arguments.log, arguments.hash.strip().lower())
    if arguments.json:
        print(json.dumps(_as_json(found), indent=2))
    else:
        print('\n'.join([*_table(found.entries), _conclusion(found)]))
    return 0 if found.whole else 1


def _as_json(found: 'Verification') -> dict[str, Any]:
    """Return the entries before the first bad line, and what is wrong with that line."""
    return {
        'whole': found.whole,
        'bad_line': found.bad_line or None,
        'problem': found.problem or None,
        'reason': found.reason or None,
        'torn_bytes': len(found.torn),
        'unended': found.unended,
        'entries': [asdict(entry) for entry in found.entries],
    }


def _table(entries: 'Sequence[Entry]') -> Iterator[str]:
    """Yield a line for each value that was changed."""
    yield f'{"entry":>5}  {"time":26}  {"kind":11}  what: old -> new'
    for entry in entries:
        for what, old, new in _changes(entry):
            begin = f'{entry.sequence:>5}  {entry.time[:26]:26}  {entry.kind:11}'
            yield f'{begin}  {what}: {_short(old)} -> {_short(new)}'


def _conclusion(found: 'Verification') -> str:
    """Return the last line: whether the chain is whole, or where it is broken."""
    count = len(found.entries)
    if not found.whole:
        return f'BROKEN: line {found.bad_line}: {found.problem}: {found.reason}'
    last = f', the last one has the hash {found.entries[-1].hash}' if count else ''
    torn = '; a last one was cut off by power loss' if found.torn else ''
    if found.unended:
        torn = '; the end of its line was cut off by power loss'
    return f'the chain is whole: {count} entries{last}{torn}'


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

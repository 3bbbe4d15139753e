# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an audit log says, in words: whether it is whole, and what each entry changed.

A log is only as good as who may write it: its texts may hold anything, and its values be of any
kind.
"""

import json
from typing import Any

from checkweigher_production.audit_log import Entry, Verification

_WIDEST = 40  # characters of a value


def conclusion(found: Verification) -> str:
    """Return whether the chain is whole, or where it is broken, in one line."""
    count = len(found.entries)
    if not found.whole and not found.bad_line:
        return f'BROKEN: {found.reason}'
    if not found.whole:
        return f'BROKEN: line {found.bad_line}: {found.problem}: {found.reason}'
    last = torn = ''
    if count:
        entry = found.entries[-1]
        last = f', the last one of {shortened(entry.time)} has the hash {entry.hash}'
    if found.torn:
        torn = '; a last one was cut off by power loss'
    if found.unended:
        torn = '; the end of its line was cut off by power loss'
    return f'the chain is whole: {count} entries{last}{torn}'


def changes(entry: Entry) -> list[tuple[str, Any, Any]]:
    """Return name, old and new value of each change; only the number of values that are all new."""
    old, new = entry.old, entry.new
    if not isinstance(new, dict):
        return [(entry.subject, old, new)]
    if not old or not isinstance(old, dict):
        return [(entry.subject, None, f'{len(new)} values')]
    names = [name for name in new if new[name] != old.get(name)]
    return [(f'{entry.subject}.{name}', old.get(name), new[name]) for name in names]


def shortened(value: Any, widest: int = _WIDEST) -> str:
    """Return a value as one printable line of at most `widest` characters, a dash for None."""
    text = '-' if value is None else value if isinstance(value, str) else json.dumps(value)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= widest else text[: widest - 3] + '...'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Text of an audit log for the user: whether it is whole, and what each entry changed.

The texts and values of a log are not trusted; they may be of any type.
"""

import json
from typing import Any

from checkweigher_production.audit_log import Entry, Verification

_WIDEST = 40  # characters of a value


def conclusion(found: Verification) -> str:
    """Return one line that says whether the hash chain is whole, or where it is broken."""
    if not found.whole:
        place = f'line {found.bad_line}: {found.problem}: ' if found.bad_line else ''
        return f'BROKEN: {place}{found.reason}'
    last = torn = ''
    if found.entries:
        entry = found.entries[-1]
        last = f', the last one of {shortened(entry.time)} has the hash {entry.hash}'
    if found.torn:
        torn = '; a last one was cut off by power loss'
    return f'the chain is whole: {len(found.entries)} entries{last}{torn}'


def changes(entry: Entry) -> list[tuple[str, Any, Any]]:
    """Return name, old and new value of each change, or the number of values if all are new."""
    old, new = entry.old, entry.new
    if not isinstance(new, dict):
        return [(entry.subject, old, new)]
    if not old or not isinstance(old, dict):
        return [(entry.subject, None, f'{len(new)} values')]
    names = [name for name in new if new[name] != old.get(name)]
    return [(f'{entry.subject}.{name}', old.get(name), new[name]) for name in names]


def shortened(value: Any, widest: int = _WIDEST) -> str:
    """Return a value as printable text of at most `widest` characters, a dash for None."""
    text = '-' if value is None else value if isinstance(value, str) else json.dumps(value)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= widest else text[: widest - 3] + '...'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts on an audit log for the user.

The values in a log may be of any type and are not trusted.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import datetime
from itertools import pairwise
import json
from typing import Any

from checkweigher_core.changes import SOFTWARE
from checkweigher_production.audit_log import Entry, Verification

_WIDEST = 40  # default limit of the length of a text in characters


def conclusion(found: Verification) -> str:
    """Return one line that states whether a log is valid or where its first fault is."""
    if not found.whole:
        place = f'line {found.bad_line}: {found.problem}: ' if found.bad_line else ''
        return f'BROKEN: {place}{found.reason}'
    last = torn = ''
    if found.entries:
        entry = found.entries[-1]
        last = f', the last one of {shortened(entry.time)} has the hash {entry.hash}'
    if software := software_in(found.entries):
        torn = f'; the line runs the legally relevant software {software}'
    if found.torn:
        torn += '; a last one was cut off by power loss'
    return f'the chain is whole: {len(found.entries)} entries{last}{torn}'


def software_in(entries: Sequence[Entry]) -> str:
    """Return the SHA-256 of the legally relevant software according to the latest entry, or ''."""
    values = (e.new for e in reversed(entries) if e.kind == SOFTWARE and isinstance(e.new, dict))
    return shortened(next(values, {}).get('sha256', ''), 64)


def steps_back(entries: Sequence[Entry]) -> Iterator[str]:
    """Yield a sentence for each entry that has an earlier time than the previous entry."""
    for before, entry in pairwise(entries):
        with suppress(ValueError, TypeError):
            back = datetime.fromisoformat(before.time) - datetime.fromisoformat(entry.time)
            if back.total_seconds() > 0:
                yield (
                    f'the time goes back by {back.total_seconds():.3f} s at entry {entry.sequence}'
                )


def changes(entry: Entry) -> list[tuple[str, Any, Any]]:
    """Return the name, the old value and the new value of each change in an entry.

    An entry whose new value is not a dict is a single change of its subject. If the new value is a
    dict, each key whose value differs is a change. If the old value is empty or not a dict, a
    single change states the number of new values.
    """
    old, new = entry.old, entry.new
    if not isinstance(new, dict):
        return [(entry.subject, old, new)]
    if not old or not isinstance(old, dict):
        return [(entry.subject, None, f'{len(new)} values')]
    names = [name for name in new if new[name] != old.get(name)]
    return [(f'{entry.subject}.{name}', old.get(name), new[name]) for name in names]


def shortened(value: Any, widest: int | None = _WIDEST) -> str:
    """Return a value as printable text with at most `widest` characters.

    A longer text is cut, and ends with three dots. If `widest` is None, the text is not cut. The
    value None becomes a dash.
    """
    text = '-' if value is None else value if isinstance(value, str) else json.dumps(value)
    text = text if text.isprintable() else repr(text)
    return text if widest is None or len(text) <= widest else text[: widest - 3] + '...'

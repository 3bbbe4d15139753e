"""What `audit` shows of an audit log."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
import json
from typing import Any

from checkweigher_dsp.production.audit_log import Entry, Verification

_WIDEST = 40  # characters of a value


def as_table(entries: Sequence[Entry]) -> Iterator[str]:
    """Yield a line for each change; one for each value where an entry has several."""
    yield f'{"entry":>5}  {"time":26}  {"kind":11}  what: old -> new'
    for entry in entries:
        for what, old, new in _changes(entry):
            yield (
                f'{entry.sequence:>5}  {entry.time[:26]:26}  {entry.kind:11}  '
                f'{what}: {_short(old)} -> {_short(new)}'
            )


def conclusion(found: Verification) -> str:
    """Return the last line: whether the chain is whole, or where it is not."""
    count = len(found.entries)
    if not found.whole:
        return f'BROKEN: line {found.bad_line}: {found.problem}: {found.reason}'
    last = f', the last one has the hash {found.entries[-1].hash}' if count else ''
    torn = '; a last one was cut off by power loss' if found.torn else ''
    return f'the chain is whole: {count} entries{last}{torn}'


def as_json(found: Verification) -> str:
    """Return the entries before the first bad line and what was found, as JSON."""
    return json.dumps(
        {
            'whole': found.whole,
            'bad_line': found.bad_line or None,
            'problem': found.problem or None,
            'reason': found.reason or None,
            'torn_bytes': len(found.torn),
            'entries': [asdict(entry) for entry in found.entries],
        },
        indent=2,
    )


def _changes(entry: Entry) -> list[tuple[str, Any, Any]]:
    """Return what an entry changed; of what was not known before only how much it is."""
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

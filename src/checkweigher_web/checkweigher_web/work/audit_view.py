# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""State, seals and latest entries of an audit log as texts for the page."""

import asyncio
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from checkweigher_core.printable import one_line
from checkweigher_production.audit_log import AuditError, Entry, Verification, read_log
from checkweigher_production.audit_seal import hold_to_seals, sealing, seals_path
from checkweigher_production.audit_words import changes, conclusion, shortened
from checkweigher_web.languages.language import Text

NEWEST = 200  # maximum number of entries that are shown
HEADS = (
    Text('entry'),
    Text('time, UTC'),
    Text('who'),
    Text('kind'),
    Text('what: before → after'),
    Text('why'),
)
_MOST = 20  # maximum number of changes of an entry that are shown
_LONGEST = 200  # maximum number of characters of a name, a value or a reason


@dataclass(frozen=True, slots=True)
class AuditView:
    """Texts that the page shows about an audit log."""

    whole: bool
    conclusion: str  # conclusion that the command `audit` prints, or the reason for an error.
    # Whether the seals are valid, or None if they were not verified. The value is False if there is
    # a key but no file of seals.
    seals_hold: bool | None = None
    seals: str = ''  # state of the seals, or '' if the conclusion contains it
    count: str = ''  # text with the number of entries, or '' if the log cannot be read.
    # A row with the cells of HEADS for each shown entry, the newest entry first.
    rows: tuple[tuple[str, ...], ...] = ()


class Auditor:
    """Reader of audit logs, which verifies their seals with the public key `trust`.

    One log is read at a time, because a large log takes seconds and much memory.
    """

    def __init__(self, trust: Ed25519PublicKey | None = None) -> None:
        self._trust = trust
        self._turn = asyncio.Lock()

    async def read(self, log: Path, wanted: str) -> AuditView:
        """Return the texts of `view_of` about a log, or the reason why the log cannot be read."""
        async with self._turn:
            try:
                return await asyncio.to_thread(view_of, log, self._trust, wanted)
            except AuditError as error:
                return AuditView(False, str(error))


def view_of(log: Path, key: Ed25519PublicKey | None, wanted: str = '') -> AuditView:
    """Return the texts about an audit log, or raise `AuditError` if it cannot be read.

    Parameters
    ----------
    log : Path
        Audit log. The file of its seals is in the same folder.
    key : Ed25519PublicKey or None
        Public key of the seals. If it is None, the seals are not verified.
    wanted : str, optional
        Filter. An entry is shown if its row or the name of its node contains this text, regardless
        of case. Of these entries, only the newest `NEWEST` are shown.
    """
    found, hold, seals = _sealed(log, read_log(log), key)
    sought = wanted.strip().casefold()
    shown = [
        entry
        for entry in reversed(found.entries)
        if not sought or sought in f'{one_line(entry.source)} {" ".join(_row(entry))}'.casefold()
    ]
    return AuditView(
        whole=found.whole,
        conclusion=conclusion(found),
        seals_hold=hold,
        seals=seals,
        count=_count(found, len(shown), wanted.strip()),
        rows=tuple(_row(entry) for entry in shown[:NEWEST]),
    )


def _sealed(
    log: Path, found: Verification, key: Ed25519PublicKey | None
) -> tuple[Verification, bool | None, str]:
    """Check the seals of a log, and return the log, the validity of the seals, and a text on them.

    The validity is None if the log is not whole, or if `key` is None. The validity is False if
    there is a key but no file of seals. The returned log is not whole if its seals are not valid.
    """
    path, command = seals_path(log), f'./checkweigher audit {quote(str(log))} --trust PUBLIC'
    if not found.whole:  # Seals can be verified only for an unbroken chain.
        return found, None, ''
    if not path.exists():
        elsewhere = f'{command} --seals FILE'
        text = Text(
            'There are no seals in {path}. To verify those that are elsewhere, run {command}',
            path=path,
            command=elsewhere,
        )
        return found, None if key is None else False, text
    if key is None:
        text = Text(
            'There are seals in {path}, and the page has no public key to verify them: start it '
            'with --trust PUBLIC, or run {command}',
            path=path,
            command=command,
        )
        return found, None, text
    seals, found = hold_to_seals(found, path, key)
    return found, found.whole, sealing(seals, found.entries) if found.whole else ''


def _count(found: Verification, matching: int, wanted: str) -> Text:
    count = len(found.entries)
    there = Text('{count} entries', count=count)
    if not found.whole and found.bad_line:
        there = Text('{count} entries before line {line}', count=count, line=found.bad_line)
    if wanted:
        there = Text(
            '{entries}, {count} of them with {text}',
            entries=there,
            count=matching,
            text=repr(wanted),
        )
    if matching > NEWEST:
        there = Text('{entries}; the newest {count} are shown', entries=there, count=NEWEST)
    return there


def _row(entry: Entry) -> tuple[str, ...]:
    changed = changes(entry)
    what = [_change(*each) for each in changed[:_MOST]]
    if len(changed) > _MOST:
        what.append(f'and {len(changed) - _MOST} more')
    return (
        str(entry.sequence),
        shortened(entry.time)[:19].replace('T', ' '),  # date and time without fractions of a second
        shortened(entry.who),
        shortened(entry.kind),
        '\n'.join(what),
        shortened(entry.why or '', _LONGEST),
    )


def _change(what: object, old: object, new: object) -> str:
    before = '' if old is None else f'{_value(old)} → '
    return f'{one_line(what, _LONGEST)}: {before}{_value(new)}'


def _value(value: object) -> str:
    return shortened(value, _LONGEST) or "''"

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Successive audit logs of a line. The first entry of a log names the log before it."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from checkweigher_core.changes import LOG
from checkweigher_production.audit_log import (
    FIRST_PREVIOUS,
    AuditError,
    AuditLog,
    Entry,
    Verification,
    read_log,
)

LOG_FILE = 'audit.log'  # file name of the latest log in the machine folder
PREDECESSOR = 'predecessor'


@dataclass(frozen=True, slots=True)
class LogChain:
    """Audit log with the earlier logs of the same line, which are in the same folder."""

    logs: tuple[tuple[Path, Verification], ...]  # each log with its verification, oldest first.
    # Reasons why logs cannot be trusted or are missing, separated by '; ', or empty.
    fault: str = ''

    @property
    def entries(self) -> list[Entry]:
        """Entries of all logs, oldest first."""
        return [entry for _, found in self.logs for entry in found.entries]

    @property
    def identity(self) -> str:
        """Text with the name of the latest log, the number of its entries, and its last hash."""
        path, found = self.logs[-1]
        last = _last_hash(found)
        return f'{path.name}, {len(found.entries)} entries, the last one has the hash {last}'


def read_chain(path: Path) -> LogChain:
    """Read an audit log and all earlier logs. The first entry of a log names the log before it.

    Raises `AuditError` if `path` cannot be read. The `fault` of the result names each log that is
    not valid, that cannot be read, or whose last entry is not the one that the next log names.
    Logs before a log that cannot be read are not read.
    """
    logs: list[tuple[Path, Verification]] = [(path, read_log(path))]
    faults = []
    while True:
        newer, found = logs[0]
        if not found.whole:
            place = f'line {found.bad_line}: {found.problem}'
            faults.append(f'the audit log {newer.name} is not whole: {place}: {found.reason}')
        named = predecessor_of(found.entries)
        if not named:
            break
        older = newer.with_name(Path(str(named.get('file', ''))).name)
        try:
            if any(older == each for each, _ in logs):
                raise AuditError(f'{older}: names itself as an earlier log')
            logs.insert(0, (older, read_log(older)))
        except AuditError as error:
            faults.append(f'the log before {newer.name} is missing: {error}')
            break
        if str(named.get('hash')) != _last_hash(logs[0][1]):
            faults.append(f'{older.name} does not end with the entry that {newer.name} names')
    return LogChain(tuple(logs), '; '.join(faults))


def _last_hash(found: Verification) -> str:
    return found.entries[-1].hash if found.entries else FIRST_PREVIOUS


def predecessor_of(entries: Sequence[Entry]) -> dict[str, object] | None:
    """Return the file name, number of entries and last hash that a log states for the previous log.

    `entries` are the entries of the log. Returns a dict with the keys 'file', 'entries' and 'hash',
    or None if there are no entries or the first entry does not name a previous log.
    """
    for entry in entries[:1]:
        if (entry.kind, entry.subject) == (LOG, PREDECESSOR) and isinstance(entry.new, dict):
            return entry.new
    return None


def logs_in(folder: Path) -> list[Path]:
    """Return the paths of the audit logs in a folder, sorted by name.

    The path ``LOG`` is returned for each file ``LOG.head`` in the folder.
    """
    return sorted(head.with_suffix('') for head in folder.glob('*.head'))


def name_predecessor(log: AuditLog, time: str, source: str) -> None:
    """Write the first entry of a new log, which names the previous log of the node `source`.

    The previous log is the other log of this node in the same folder whose last entry is the
    latest. If there is no other log, the new value of the entry is None. A log that contains
    entries is left unchanged.

    Raises `AuditError` if the entry cannot be written.
    """
    if log.entries:
        return
    latest = max(_written_by(log.path, source), default=None)
    named = None
    if latest is not None:
        _, name, count, digest = latest
        named = {'file': name, 'entries': count, 'hash': digest}
    log.append(time, source, LOG, PREDECESSOR, None, named)


def _written_by(path: Path, source: str) -> Iterator[tuple[str, str, int, str]]:
    """Yield a tuple for each other log that contains an entry of the node `source`.

    The tuple contains the time of the last entry, the file name, the number of entries and the hash
    of the last entry. The logs in the folder of `path` are searched, except the log `path` itself.
    Logs that cannot be read, and entries after the first fault of a log, are left out.
    """
    for other in logs_in(path.parent):
        with suppress(AuditError):
            entries = read_log(other).entries if other.name != path.name else ()
            if any(each.source == source for each in entries):
                yield entries[-1].time, other.name, len(entries), entries[-1].hash

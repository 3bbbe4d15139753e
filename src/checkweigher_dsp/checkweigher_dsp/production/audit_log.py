# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit log: changes with their times, in a file whose lines are chained by hashes.

One entry a line, JSON in one fixed form. An entry holds the SHA-256 of the entry before it and its
own, over all its other fields; so a line that was changed, removed, inserted or moved breaks the
chain. The number of the last entry stands in a second file, `LOG.head`, written after each entry:
it shows that lines were cut off at the end. A power loss can leave the beginning of an entry that
`LOG.head` never knew: such a torn end is no tampering, and the next entry records it.

The chain has no key. A person who may write both files can rewrite them from the changed entry on;
a hash that was noted elsewhere shows that (`verify` with `known_hash`).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
import fcntl
import hashlib
import json
import math
import os
from pathlib import Path
import tempfile
from typing import Any, Self

FIRST_PREVIOUS = '0' * 64
TORN = 'torn'


class AuditError(ValueError):
    """An audit log that cannot be used; one line that says which and why."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry; NaN and infinities in values stand as ``'nan'``, ``'inf'`` and ``'-inf'``."""

    sequence: int  # from 1, without gaps
    time: str  # ISO 8601, UTC
    source: str  # node that wrote it, with its namespace
    kind: str  # 'parameter', 'recipe', 'calibration', ...
    subject: str  # name of the thing that was changed
    old: Any  # JSON value, None: there is none
    new: Any
    previous: str  # SHA-256 of the entry before, hexadecimal
    hash: str = ''  # SHA-256 of this entry

    def line(self) -> bytes:
        """Return the line of the entry in the file."""
        return _canonical(asdict(self)) + b'\n'

    def digest(self) -> str:
        """Return the SHA-256 over all but ``hash``."""
        values = asdict(self)
        del values['hash']
        return hashlib.sha256(_canonical(values)).hexdigest()


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of verifying a log."""

    entries: tuple[Entry, ...]  # before the first bad line
    bad_line: int = 0  # number of the first bad line, from 1; 0 if there is none
    problem: str = ''  # 'changed', 'removed', 'inserted' or 'cut'; empty if the chain is whole
    reason: str = ''  # the fault in words
    torn: bytes = b''  # beginning of an entry at the end that was never finished

    @property
    def whole(self) -> bool:
        """Whether the chain is whole."""
        return not self.problem


def head_path(path: Path) -> Path:
    """Return the file beside a log that has the number of its last entry."""
    return path.with_name(path.name + '.head')


def read_log(path: Path, known_hash: str = '') -> Verification:
    """Verify a log and the file beside it; `AuditError` if the log cannot be read."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise AuditError(f'{path}: {error.strerror or error}') from None
    try:
        head = head_path(path).read_bytes()
    except OSError:
        head = b''
    return verify(data, head, known_hash)


def verify(data: bytes, head: bytes, known_hash: str = '') -> Verification:
    """Verify a log by the file beside it (empty if there is none) and by a hash that it has."""
    entries: list[Entry] = []
    try:
        torn = _follow_chain(data, entries)
        _check_head(entries, torn, head)
        if known_hash and known_hash not in {entry.hash for entry in entries}:
            reason = f'no entry has the hash {known_hash}: the log is not the one it was taken from'
            raise _FaultError(len(entries) + 1, 'cut', reason)
    except _FaultError as fault:
        return Verification(tuple(entries), *fault.args)
    return Verification(tuple(entries), torn=torn)


class _FaultError(Exception):
    """Line, problem and reason, as in `Verification`."""


def _follow_chain(data: bytes, entries: list[Entry]) -> bytes:
    """Append the entries of a log; return the bytes of an entry that was not finished."""
    lines = data.split(b'\n')
    parsed = [*map(_parse, lines[:-1]), None]  # behind the last end of line there is no entry
    previous, torn = FIRST_PREVIOUS, b''
    at = 0
    while at < len(lines):
        entry = parsed[at]
        if entry is not None:
            _check_place(at + 1, entry, len(entries) + 1, previous, torn)
            entries.append(entry)
            previous, torn = entry.hash, b''
            at += 1
            continue
        end = next((n for n in range(at, len(lines)) if parsed[n]), len(lines))
        torn = b'\n'.join(lines[at:end])
        if end == len(lines) and _may_be_torn(torn, len(entries) + 1):
            return torn
        if end == len(lines) or not _records(parsed[end], torn):
            raise _FaultError(at + 1, 'changed', 'it is no entry, or not as it was written')
        at = end
    return b''


def _check_place(line: int, entry: Entry, expected: int, previous: str, torn: bytes) -> None:
    number = entry.sequence
    if entry.kind == TORN and not (torn and _records(entry, torn)):
        raise _FaultError(line, 'removed', 'the torn entry that it records is not there before it')
    if number > expected:
        reason = f'entry {number} stands where entry {expected} should be'
        raise _FaultError(line, 'removed', reason)
    if number < expected or entry.previous != previous:
        raise _FaultError(line, 'inserted', f'entry {number} does not follow the entry before it')


def _may_be_torn(end: bytes, expected: int) -> bool:
    """Tell whether a power loss or a full disk may have left this of the entry `expected`."""
    beginning = b'{"sequence":%d,' % expected
    first = end.split(b'\n')[0]
    begun = first.startswith(beginning) or (first != b'' and beginning.startswith(first))
    # Some file systems leave zeros, or what stood there before. A file without any entry, though,
    # is rather no log at all.
    return begun or not end.strip(b'\0') or (expected > 1 and not end.endswith(b'\n'))


def _check_head(entries: list[Entry], torn: bytes, head: bytes) -> None:
    """Find entries that were cut off at the end; one more than the head knows is no harm."""
    count = len(entries)
    if not head:
        if count > 1:  # a power loss between the first entry and its head leaves one
            reason = 'the file LOG.head is missing, so the number of entries is not known'
            raise _FaultError(count + 1, 'cut', reason)
        return
    try:
        known = json.loads(head)
        sequence, digest = int(known['sequence']), str(known['hash'])
        if _head_text(sequence, digest) != head:
            raise ValueError
    except (ValueError, TypeError, KeyError):
        reason = 'the file LOG.head is not as it was written'
        raise _FaultError(count + 1, 'changed', reason) from None
    if sequence > count:
        problem = 'changed' if torn.endswith(b'\n') else 'cut'
        reason = f'the log ends with entry {count}, but went on to entry {sequence}'
        raise _FaultError(count + 1, problem, reason)
    if sequence < 1 or entries[sequence - 1].hash != digest:
        reason = f'entry {sequence} is not the one that LOG.head knows'
        raise _FaultError(max(sequence, 1), 'changed', reason)
    if count - sequence > 1:
        reason = f'LOG.head knows {sequence} entries, the log has {count}'
        raise _FaultError(sequence + 1, 'inserted', reason)


class AuditLog:
    """A log that is open for appending, locked against other processes.

    `entries` are those of the file when it was opened, `last_hash` is that of the last one now.

    Raises
    ------
    AuditError
        If it cannot be opened, another process has it open, or its chain is broken.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        except OSError as error:
            raise AuditError(f'{path}: {error.strerror or error}') from None
        try:
            self._read()
        except BaseException:
            self.close()
            raise

    def _read(self) -> None:
        """Lock the log and read the entries that it has."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise AuditError(f'{self.path}: another process writes to this log') from None
        found = read_log(self.path)
        if not found.whole:
            raise AuditError(
                f'{self.path}: line {found.bad_line}: {found.problem}: {found.reason}; keep this '
                'log as it is and name another file'
            )
        self.entries = found.entries
        self._count = len(found.entries)
        self.last_hash = found.entries[-1].hash if found.entries else FIRST_PREVIOUS
        self._torn = found.torn
        # Where power was lost between an entry and its head, the head is one behind.
        if self._count:
            self._write_head()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the log."""
        os.close(self._file)

    def append(
        self, time: str, source: str, kind: str, subject: str, old: object, new: object
    ) -> Entry:
        """Append an entry; once this returns, it is on the disk. `AuditError` if it cannot be."""
        try:
            if self._torn:
                # First the end of the torn line, then its record: a reader needs both.
                torn = _fingerprint(self._torn)
                self._write((time, source, TORN, 'last entry', None, torn), b'\n')
            return self._write((time, source, kind, subject, plain(old), plain(new)))
        except OSError as error:
            raise AuditError(f'{self.path}: {error.strerror or error}') from None

    def _write(self, change: tuple[str, str, str, str, Any, Any], before: bytes = b'') -> Entry:
        """Write the entry of a change, behind some other bytes."""
        entry = Entry(self._count + 1, *change, self.last_hash)
        entry = replace(entry, hash=entry.digest())
        line = before + entry.line()
        written = os.write(self._file, line)
        if written < len(line):
            self._torn = self._torn + line[:written]
            raise OSError(0, 'the disk is full')
        os.fsync(self._file)
        self._count, self.last_hash, self._torn = entry.sequence, entry.hash, b''
        self._write_head()
        return entry

    def _write_head(self) -> None:
        path = head_path(self.path)
        number, name = tempfile.mkstemp(prefix=f'.{path.name}-', dir=path.parent)
        try:
            with open(number, 'wb') as file:
                file.write(_head_text(self._count, self.last_hash))
                file.flush()
                os.fsync(file.fileno())
            os.chmod(name, 0o644)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise


def plain(value: object) -> Any:
    """Return a value as JSON has it: sequences as lists, NaN and infinities as strings."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, (str, bool, int, float)) or value is None:
        return value
    if hasattr(value, '__iter__'):
        return [plain(each) for each in value]
    return str(value)


def _parse(line: bytes) -> Entry | None:
    """Return the entry of a line, None if the line is not byte for byte as it was written."""
    try:
        entry = Entry(**json.loads(line))
        good = entry.line() == line + b'\n' and entry.digest() == entry.hash
    except (ValueError, TypeError, RecursionError):
        return None
    return entry if good and type(entry.sequence) is int else None


def _records(entry: Entry | None, torn: bytes) -> bool:
    return entry is not None and entry.kind == TORN and entry.new == _fingerprint(torn)


def _fingerprint(torn: bytes) -> dict[str, object]:
    return {'bytes': len(torn), 'sha256': hashlib.sha256(torn).hexdigest()}


def _canonical(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, allow_nan=False, separators=(',', ':')).encode('ascii')


def _head_text(sequence: int, digest: str) -> bytes:
    return _canonical({'sequence': sequence, 'hash': digest}) + b'\n'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The audit log: changes with their times, in a file whose lines are chained by hashes.

One entry a line, JSON in one fixed form. An entry holds the SHA-256 of the entry before it and its
own, over all its other fields; so a line that was changed, removed, inserted or moved breaks the
chain. The number of the last entry stands in a second file, `LOG.head`, written after each entry
and when the log is begun: it shows that lines were cut off at the end. A power loss can leave the
beginning of an entry that `LOG.head` never knew, or all of it but the end of its line: such a torn
end is no tampering, and the next entry records it.

The chain has no key. A person who may write both files can rewrite them from the changed entry on;
a hash that was noted elsewhere shows that (`verify` with `known_hash`).
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
import errno
import fcntl
import hashlib
import json
import os
from pathlib import Path
import re
from typing import Any, Self

from checkweigher_core.changes import plain
from checkweigher_core.input_files import read_input

FIRST_PREVIOUS = '0' * 64
TORN = 'torn'
MAX_LOG = 2**25  # bytes
_HEAD = re.compile(rb'\{"sequence":(0|[1-9]\d{0,17}),"hash":"([0-9a-f]{64})"\}\n')


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
    who: str | None = None  # person, or 'graph:' and a node; None in logs of older versions
    why: str | None = None  # the reason that was given, empty for none

    def line(self) -> bytes:
        """Return the line of the entry in the file."""
        return _canonical(self._values()) + b'\n'

    def digest(self) -> str:
        """Return the SHA-256 over all but ``hash``."""
        values = self._values()
        del values['hash']
        return hashlib.sha256(_canonical(values)).hexdigest()

    def _values(self) -> dict[str, Any]:
        """Return the fields, the hash last, without those that an older version did not write."""
        values = asdict(self)
        if self.who is None:
            del values['who'], values['why']
        values['hash'] = values.pop('hash')
        return values


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of verifying a log."""

    entries: tuple[Entry, ...]  # before the first bad line
    bad_line: int = 0  # number of the first bad line, from 1; 0 if there is none
    problem: str = ''  # 'changed', 'removed', 'inserted' or 'cut'; empty if the chain is whole
    reason: str = ''  # the fault in words
    torn: bytes = b''  # beginning of an entry at the end that was never finished
    unended: bool = False  # the last entry has all but the end of its line

    @property
    def whole(self) -> bool:
        """Whether the chain is whole."""
        return not self.problem


def head_path(path: Path) -> Path:
    """Return the file beside a log that has the number of its last entry."""
    return path.with_name(path.name + '.head')


def read_log(path: Path, known_hash: str = '') -> Verification:
    """Verify a log and the file beside it; `AuditError` if the log cannot be read."""
    while True:  # until no entry has come in between
        head = _read_head(path)
        data = _read_file(path)
        if _read_head(path) == head:
            return verify(data, head, known_hash)


def _read_file(path: Path) -> bytes:
    try:
        return read_input(path)
    except OSError as error:
        raise AuditError(f'{path}: {error.strerror or error}') from None


def _read_head(path: Path) -> bytes:
    """Return what is in the head of a log, empty if there is none."""
    with suppress(OSError):
        return head_path(path).read_bytes()
    return b''


def verify(data: bytes, head: bytes, known_hash: str = '') -> Verification:
    """Verify a log by the file beside it (empty if there is none) and by a hash that it has."""
    chain = _Chain()
    try:
        chain.follow(data)
        _check_head(chain, head)
        if known_hash and known_hash not in {entry.hash for entry in chain.entries}:
            reason = f'no entry has the hash {known_hash}: the log is not the one it was taken from'
            raise _FaultError(chain.lines + 1, 'cut', reason)
    except _FaultError as fault:
        return Verification(tuple(chain.entries), *fault.args)
    return Verification(tuple(chain.entries), torn=chain.torn, unended=chain.unended)


class _FaultError(Exception):
    """Line, problem and reason, as in `Verification`."""


@dataclass
class _Chain:
    """A log as far as it has been followed, and what is left of an entry that was not finished."""

    entries: list[Entry] = field(default_factory=list)  # those followed since the last `forget`
    count: int = 0
    last_hash: str = FIRST_PREVIOUS
    lines: int = 0  # of these entries and of what was torn between them
    torn: bytes = b''
    unended: bool = False

    def follow(self, data: bytes) -> None:
        """Take all that stands behind the last entry that has an end of line."""
        lines = data.split(b'\n')
        # Behind the last end of line there is no entry, or one that lacks nothing but that.
        parsed = [*map(_parse, lines)]
        self.torn, self.unended = b'', False
        at = 0
        while at < len(lines):
            entry = parsed[at]
            if entry is not None:
                self._check_place(entry)
                self.add(entry)
                at += 1
                self.unended = at == len(lines)
                continue
            end = next((n for n in range(at, len(lines)) if parsed[n]), len(lines))
            self.torn = b'\n'.join(lines[at:end])
            if end == len(lines) and _may_be_torn(self.torn, self.count + 1):
                return
            if end == len(lines) or not _records(parsed[end], self.torn):
                reason = 'it is no entry, or not as it was written'
                raise _FaultError(self.lines + 1, 'changed', reason)
            self.lines += end - at
            at = end

    def _check_place(self, entry: Entry) -> None:
        number, expected, line = entry.sequence, self.count + 1, self.lines + 1
        if entry.kind == TORN and not _records(entry, self.torn):
            reason = 'the torn entry that it records is not there before it'
            raise _FaultError(line, 'removed', reason)
        if number > expected:
            reason = f'entry {number} stands where entry {expected} should be'
            raise _FaultError(line, 'removed', reason)
        if number < expected or entry.previous != self.last_hash:
            reason = f'entry {number} does not follow the entry before it'
            raise _FaultError(line, 'inserted', reason)

    def add(self, entry: Entry) -> None:
        """Take the next entry."""
        self.entries.append(entry)
        self.count, self.last_hash, self.torn = entry.sequence, entry.hash, b''
        self.lines += 1


def _may_be_torn(end: bytes, expected: int) -> bool:
    """Tell whether a power loss or a full disk may have left this of the entry `expected`."""
    beginning = b'{"sequence":%d,' % expected
    first = end.split(b'\n')[0]
    begun = first.startswith(beginning) or (first != b'' and beginning.startswith(first))
    # Some file systems leave zeros, or what stood there before. A file without any entry, though,
    # is rather no log at all.
    return begun or not end.strip(b'\0') or (expected > 1 and not end.endswith(b'\n'))


def _check_head(chain: _Chain, head: bytes) -> None:
    """Find entries that were cut off at the end; one more than the head knows is no harm."""
    count, line = chain.count, chain.lines + 1
    if not head:
        what = f'the log has {count} entries' if count else 'the log is empty'
        reason = f'{what}, and the file LOG.head is missing, so it is not known how many there were'
        raise _FaultError(line, 'cut', reason)
    known = _HEAD.fullmatch(head)
    if known is None:
        raise _FaultError(line, 'changed', 'the file LOG.head is not as it was written')
    sequence, digest = int(known[1]), known[2].decode()
    if sequence > count:
        problem = 'changed' if chain.torn.endswith(b'\n') else 'cut'
        reason = f'the log ends with entry {count}, but went on to entry {sequence}'
        raise _FaultError(line, problem, reason)
    if count - sequence > 1:
        reason = f'LOG.head knows {sequence} entries, the log has {count}'
        raise _FaultError(line - count + sequence, 'inserted', reason)
    hashes = [FIRST_PREVIOUS, *(entry.hash for entry in chain.entries[-2:])]
    if hashes[sequence - count - 1] != digest:
        reason = f'entry {sequence} is not the one that LOG.head knows'
        raise _FaultError(line - 1 - count + sequence, 'changed', reason)
    if chain.unended and sequence == count:
        reason = f'the end of line behind entry {count}, which LOG.head knows, is missing'
        raise _FaultError(line - 1, 'cut', reason)


class AuditLog:
    """A log that is open for appending, locked against other processes.

    `entries` are those of the file when it was opened, `last_hash` is that of the last one now.
    Before each entry log and head are compared with what was left there: a log that was replaced,
    cut or changed meanwhile is not written to.

    Raises
    ------
    AuditError
        If it cannot be opened, another process has it open, or its chain is broken.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chain = _Chain()
        try:
            if not path.exists() and not head_path(path).exists():
                self._write_head(0, FIRST_PREVIOUS)
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
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
        data, self._head = _read_file(self.path), _read_head(self.path)
        try:
            self._chain.follow(data)
            _check_head(self._chain, self._head)
        except _FaultError as fault:
            line, problem, reason = fault.args
            raise AuditError(
                f'{self.path}: line {line}: {problem}: {reason}; keep this log as it is and name '
                'another file'
            ) from None
        self.entries, self._chain.entries = tuple(self._chain.entries), []
        self._size, self._state = len(data), os.fstat(self._file)
        self._altered = ''

    @property
    def last_hash(self) -> str:
        """Hash of the last entry."""
        return self._chain.last_hash

    @property
    def size(self) -> int:
        """Size of the log, bytes; `MAX_LOG` at most."""
        return self._size

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the log."""
        os.close(self._file)

    def trouble(self) -> str:
        """Return why nothing may be appended: what others did to the log; empty if nothing."""
        own = os.fstat(self._file)
        try:
            there = self.path.stat()
        except OSError as error:
            return f'{self.path}: {error.strerror or error}: it was moved or deleted'
        if not os.path.samestat(own, there):
            return f'{self.path}: is another file than the one that was opened: it was replaced'
        if own.st_size != self._size:
            return f'{self.path}: has {own.st_size} bytes instead of {self._size}: it was changed'
        if _read_head(self.path) != self._head:
            return f'{head_path(self.path)}: was changed, moved or deleted'
        if (own.st_mtime_ns, own.st_ctime_ns) != (self._state.st_mtime_ns, self._state.st_ctime_ns):
            # A copy may have touched it; only its bytes tell.
            chain = _Chain()
            with suppress(AuditError, _FaultError):
                chain.follow(_read_file(self.path))
            same = (chain.last_hash, chain.torn) == (self.last_hash, self._chain.torn)
            self._altered = '' if same else f'{self.path}: was changed'
            self._state = own
        return self._altered

    def append(
        self, time: str, source: str, kind: str, subject: str, old: object, new: object,
        who: str = '', why: str = '',
    ) -> Entry:  # fmt: skip
        """Append an entry; once this returns, it is on the disk. `AuditError` if it cannot be.

        `who` is the person, or else the `source` stands for it, `why` the reason.
        """
        if trouble := self.trouble():
            raise AuditError(f'{trouble}; restore it, and start the node product again')
        try:
            self._finish(time, source)
            change = (time, source, kind, subject, plain(old), plain(new))
            return self._write(change, who=who or f'graph:{source}', why=why)
        except OSError as error:
            raise AuditError(f'{self.path}: {error.strerror or error}') from None

    def _finish(self, time: str, source: str) -> None:
        """Finish what a loss of power, a kill or a full disk has left unfinished."""
        unended, torn = self._chain.unended, self._chain.torn
        if unended:
            self._put(b'\n')
            self._chain.unended = False
        if self._head != _head_line(self._chain.count, self.last_hash):
            os.fsync(self._file)
            self._write_head(self._chain.count, self.last_hash)
        if unended or torn:
            # First the end of the torn line, then its record: a reader needs both.
            record = (time, source, TORN, 'last entry', None, _fingerprint(torn))
            self._write(record, before=b'\n' if torn else b'', who=f'graph:{source}')

    def _write(
        self, change: tuple[str, str, str, str, Any, Any], before: bytes = b'', *, who: str,
        why: str = '',
    ) -> Entry:  # fmt: skip
        """Write the entry of a change, behind some other bytes."""
        entry = Entry(self._chain.count + 1, *change, self.last_hash, who=who, why=why)
        entry = replace(entry, hash=entry.digest())
        line = entry.line()
        if self._size + len(line) > MAX_LOG:
            raise AuditError(
                f'{self.path}: no room for an entry of {len(line)} bytes: a log may have '
                f'{MAX_LOG >> 20} MiB; name another file'
            )
        self._put(before + line, entry)
        self._chain.add(entry)
        self._chain.entries.clear()
        return entry

    def _put(self, data: bytes, entry: Entry | None = None) -> None:
        """Append bytes with the entry that they end with, and its head: all or nothing."""
        try:
            if os.write(self._file, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
            if entry is not None:
                self._write_head(entry.sequence, entry.hash)
            self._size += len(data)
        except OSError:
            try:
                os.ftruncate(self._file, self._size)
            except OSError:
                self._altered = f'{self.path}: ends with an entry that could not be finished'
            raise
        finally:
            self._state = os.fstat(self._file)

    def _write_head(self, sequence: int, digest: str) -> None:
        """Replace the head by that of an entry."""
        head = head_path(self.path)
        following = head.with_name(head.name + '.next')
        with following.open('wb') as file:
            file.write(text := _head_line(sequence, digest))
            file.flush()
            os.fsync(file.fileno())
        os.replace(following, head)
        self._head = text
        # Where this fails, a loss of power may leave the head one entry behind, which is no harm.
        with suppress(OSError):
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


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


def _head_line(sequence: int, digest: str) -> bytes:
    return _canonical({'sequence': sequence, 'hash': digest}) + b'\n'

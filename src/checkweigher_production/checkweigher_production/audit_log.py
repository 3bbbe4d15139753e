# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Audit log: a file with one line per change, in which hashes reveal later manipulation.

Each line is one entry in JSON with a fixed format. An entry contains the SHA-256 hash of the
previous entry, and its own hash over all its other fields. A line that was changed, removed,
inserted or moved therefore breaks the chain of hashes. A second file, `LOG.head`, contains the
number and the hash of the last entry. `LOG.head` is written when the log is created and after each
entry, and reveals whether lines are missing at the end.

After a power loss, the log may end with an incomplete ("torn") entry, which is not counted in
`LOG.head`, or with an entry that lacks its end of line. This is not manipulation. The next entry
records the torn entry.

The chain has no key, so a person with write access to both files can rewrite them from any entry
on. Such a change can be detected with a hash that was noted elsewhere (`known_hash` of `verify`).
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, dataclass, field, replace
import errno
import fcntl
import hashlib
import json
import os
from pathlib import Path
import re
from typing import Any

from checkweigher_core.changes import plain
from checkweigher_core.input_files import read_input
from checkweigher_core.state_files import sync_folder

FIRST_PREVIOUS = '0' * 64
TORN = 'torn'
MAX_LOG = 2**25  # largest size of a log, in bytes
_Change = tuple[str, str, str, str, Any, Any]  # values of the `Entry` fields `time` to `new`
_HEAD = re.compile(rb'\{"sequence":(0|[1-9]\d{0,17}),"hash":"([0-9a-f]{64})"\}\n')


class AuditError(ValueError):
    """Raised if an audit log cannot be used. The message names the log and the fault."""


class LogInUseError(AuditError):
    """Raised if another process has an audit log open."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Entry of a log. The numbers NaN, infinity and -infinity are stored as text."""

    sequence: int  # from 1, without gaps
    time: str  # ISO 8601, UTC
    source: str  # full name of the node that wrote the entry
    kind: str  # kind of the change: 'parameter', 'recipe', 'calibration', ...
    subject: str  # name of the changed object
    old: Any  # previous value, converted to JSON types, or None if there was none
    new: Any  # new value, converted to JSON types
    previous: str  # SHA-256 of the previous entry, hexadecimal
    hash: str = ''  # SHA-256 of this entry, hexadecimal.
    # Author of the change: name of a person, 'claimed:NAME' or 'graph:NODE', or None in old logs.
    who: str | None = None
    why: str | None = None  # reason that the author has given or '', or None in old logs

    def line(self) -> bytes:
        """Return the line of the entry in the log."""
        return _canonical(self._values()) + b'\n'

    def digest(self) -> str:
        """Return the SHA-256 hash over all fields except ``hash``, hexadecimal."""
        values = self._values()
        del values['hash']
        return hashlib.sha256(_canonical(values)).hexdigest()

    def _values(self) -> dict[str, Any]:
        """Return the fields in the order in which the file contains them.

        Entries of old logs, in which `who` is None, have no fields ``who`` and ``why``.
        """
        values = asdict(self)
        if self.who is None:
            del values['who'], values['why']
        return values | {'hash': values.pop('hash')}


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of verifying a log."""

    # Valid entries before the first fault, or all entries if `LOG.head` or the seals show a fault.
    entries: tuple[Entry, ...]
    bad_line: int = 0  # number of the first faulty line, from 1, or 0 if no such line is known.
    # Kind of the fault: 'changed', 'removed', 'inserted', 'cut' or 'seal', or '' for a valid log.
    problem: str = ''
    reason: str = ''  # description of the fault, or empty for a valid log
    torn: bytes = b''  # incomplete entry at the end of a valid log, or empty
    sha256: str = ''  # SHA-256 of the file, hexadecimal, which only `read_log` sets

    @property
    def whole(self) -> bool:
        """Whether the log is valid."""
        return not self.problem


def head_path(path: Path) -> Path:
    """Return the path of the file `LOG.head` of the log `path`."""
    return path.with_name(path.name + '.head')


def read_log(path: Path, known_hash: str = '') -> Verification:
    """Read and verify a log. `known_hash` is used as in `verify`.

    Raises `AuditError` if the log cannot be read. If the log has a fault, the result describes the
    fault.
    """
    data, head = read_consistent(path)
    return replace(verify(data, head, known_hash), sha256=hashlib.sha256(data).hexdigest())


def read_consistent(path: Path) -> tuple[bytes, bytes]:
    """Return the contents of a log and of `LOG.head` as they were at the same time.

    If `LOG.head` is missing, its content is returned as empty. Raises `AuditError` if the log
    cannot be read.
    """
    while True:  # repeated if an entry was added between the two reads
        head = _read_head(path)
        data = _read_file(path)
        if _read_head(path) == head:
            return data, head


def _read_file(path: Path) -> bytes:
    try:
        return read_input(path)
    except OSError as error:
        raise AuditError(f'{path}: {error.strerror or error}') from None


def _read_head(path: Path) -> bytes:
    with suppress(OSError):
        return head_path(path).read_bytes()
    return b''


def verify(data: bytes, head: bytes, known_hash: str = '') -> Verification:
    """Verify the bytes of a log.

    `head` contains the bytes of `LOG.head`, or is empty if that file is missing. If `known_hash` is
    not empty and no entry has this hash, the problem in the result is 'cut'.
    """
    chain = _Chain()
    try:
        chain.follow(data)
        _check_head(chain, head, ended=data.endswith(b'\n'))
        if known_hash and known_hash not in {entry.hash for entry in chain.entries}:
            raise _FaultError(
                chain.line,
                'cut',
                f'no entry has the hash {known_hash}: the log was cut or rewritten, or the hash '
                'is mistyped or of another log',
            )
    except _FaultError as fault:
        return Verification(tuple(chain.entries), *fault.args)
    return Verification(tuple(chain.entries), torn=chain.torn)


class _FaultError(Exception):
    """Raised at the first fault of a log.

    The arguments are the values of `bad_line`, `problem` and `reason` of the `Verification`.
    """


@dataclass
class _Chain:
    """Entries of a log that were found valid so far."""

    entries: list[Entry] = field(default_factory=list)
    line: int = 1  # number of the next line
    torn: bytes = b''  # incomplete entry after the valid entries

    def follow(self, data: bytes) -> None:
        """Check the entries in the bytes of a log, and add the valid entries to `entries`.

        Raises `_FaultError` at the first fault.
        """
        others: list[bytes] = []  # invalid lines since the last valid entry
        for line in data.split(b'\n'):
            entry = _parse(line)
            if entry is None:
                others.append(line)
                continue
            self.torn = b'\n'.join(others)
            if others and not _records(entry, self.torn):
                raise self._changed()
            self.line += len(others)
            self._check_place(entry)
            self.entries.append(entry)
            self.line += 1
            others = []
        # After the last valid entry, there may be an end of line, a torn entry, or nothing.
        self.torn = b'\n'.join(others)
        if not _may_be_torn(self.torn, len(self.entries) + 1):
            raise self._changed()

    def _changed(self) -> _FaultError:
        return _FaultError(self.line, 'changed', 'it is no entry, or not as it was written')

    def _check_place(self, entry: Entry) -> None:
        number, expected = entry.sequence, len(self.entries) + 1
        if entry.kind == TORN and not _records(entry, self.torn):
            raise _FaultError(
                self.line, 'removed', 'the torn entry that this line records is missing before it'
            )
        if number > expected:
            raise _FaultError(
                self.line, 'removed', f'entry {number} stands where entry {expected} should be'
            )
        if number < expected or entry.previous != _last_hash(self.entries):
            raise _FaultError(
                self.line, 'inserted', f'entry {number} does not follow the entry before it'
            )


def _may_be_torn(end: bytes, expected: int) -> bool:
    """Return whether `end` may be the beginning of entry number `expected`, or is empty."""
    beginning = b'{"sequence":%d,' % expected
    written = end.replace(b'\0', b'')  # some file systems leave zero bytes after a power loss
    begun = written.startswith(beginning) or beginning.startswith(written)
    return begun and written.isascii() and written.decode().isprintable()


def _parse_head(head: bytes, chain: _Chain) -> tuple[int, str]:
    if not head:
        count = len(chain.entries)
        what = f'the log has {count} entries' if count else 'the log is empty'
        reason = f'{what}, and the file LOG.head is missing, so it is not known how many there were'
        raise _FaultError(chain.line, 'cut', reason)
    known = _HEAD.fullmatch(head)
    if known is None:
        raise _FaultError(chain.line, 'changed', 'the file LOG.head is not as it was written')
    return int(known[1]), known[2].decode()


def _check_head(chain: _Chain, head: bytes, *, ended: bool) -> None:
    """Check whether the number and hash of the last entry in `LOG.head` fit the entries of a log.

    `LOG.head` may lack the last entry, because it is written after the entry. `ended` is True if
    the log ends with an end of line. Raises `_FaultError` if `LOG.head` is missing, is invalid or
    does not fit the entries, or if the end of line of an entry that `LOG.head` counts is missing.
    """
    count, line = len(chain.entries), chain.line
    sequence, digest = _parse_head(head, chain)
    if sequence > count:
        problem = 'changed' if chain.torn.endswith(b'\n') else 'cut'
        reason = f'the log ends with entry {count}, but went on to entry {sequence}'
        raise _FaultError(line, problem, reason)
    line -= count - sequence
    if count - sequence > 1:
        reason = f'LOG.head knows {sequence} entries, the log has {count}'
        raise _FaultError(line, 'inserted', reason)
    hashes = [FIRST_PREVIOUS, *(entry.hash for entry in chain.entries[-2:])]
    if hashes[sequence - count - 1] != digest:
        reason = f'entry {sequence} is not the one that LOG.head knows'
        raise _FaultError(line - 1, 'changed', reason)
    if sequence == count > 0 and not (ended or chain.torn):
        reason = f'the end of line behind entry {count}, which LOG.head knows, is missing'
        raise _FaultError(line - 1, 'cut', reason)


class AuditLog(AbstractContextManager['AuditLog', None]):
    """Log that is open for appending, and locked against other processes.

    If neither the log nor `LOG.head` exists, an empty log is created. Before an entry is written,
    the log and `LOG.head` are compared with their last known state. No entry is written to a log
    that was replaced, shortened or changed.

    Raises `LogInUseError` if the log is open in another process, and `AuditError` if it cannot be
    opened or is not valid.

    Attributes
    ----------
    entries : tuple of Entry
        Entries of the log when it was opened.
    last_hash : str
        Hash of the last entry.
    size : int
        Size of the log in bytes. `append` does not let it exceed `MAX_LOG`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._altered = ''
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
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise LogInUseError(f'{self.path}: another process writes to this log') from None
        data, self._head = _read_file(self.path), _read_head(self.path)
        found = verify(data, self._head)
        if not found.whole:
            raise AuditError(
                f'{self.path}: line {found.bad_line}: {found.problem}: {found.reason}; keep this '
                'log as it is and name another file'
            )
        self.entries, self._torn = found.entries, found.torn
        self._ended = not found.torn and (data.endswith(b'\n') or not data)
        self._count, self.last_hash = len(found.entries), _last_hash(found.entries)
        self.size, self._state = len(data), os.fstat(self._file)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the log."""
        os.close(self._file)

    def trouble(self) -> str:
        """Return the reason why no entry may be appended, or an empty string."""
        own = os.fstat(self._file)
        try:
            there = self.path.stat()
        except OSError as error:
            return f'{self.path}: {error.strerror or error}: it was moved or deleted'
        if not os.path.samestat(own, there):
            return f'{self.path}: is another file than the one that was opened: it was replaced'
        if own.st_size != self.size:
            return f'{self.path}: has {own.st_size} bytes instead of {self.size}: it was changed'
        if _read_head(self.path) != self._head:
            return f'{head_path(self.path)}: was changed, moved or deleted'
        if (own.st_mtime_ns, own.st_ctime_ns) != (self._state.st_mtime_ns, self._state.st_ctime_ns):
            # Compare the content, because a backup may change the times of a file.
            self._altered = f'{self.path}: was changed'
            with suppress(AuditError):
                found = read_log(self.path)
                if (_last_hash(found.entries), found.torn) == (self.last_hash, self._torn):
                    self._altered = ''
            self._state = own
        return self._altered

    def append(
        self,
        time: str,
        source: str,
        kind: str,
        subject: str,
        old: object,
        new: object,
        who: str = '',
        why: str = '',
    ) -> Entry:
        """Append an entry, sync the file to the disk, and return the entry.

        `old` and `new` are converted to JSON types. `who` is the person who makes the change, by
        default ``graph:`` followed by `source`. `why` is the reason that the person gave. Raises
        `AuditError` if the entry cannot be written or would make the log larger than `MAX_LOG`.
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
        """Complete the log after a power loss or a kill during the last write.

        Write `LOG.head` if it lacks the last entry. If the log ends with a torn entry, append an
        entry with the number and the SHA-256 of the torn bytes. Raises OSError or `AuditError` if
        the log cannot be written.
        """
        if self._head != _head_line(self._count, self.last_hash):
            os.fsync(self._file)
            self._write_head(self._count, self.last_hash)
        if self._torn:
            record = (time, source, TORN, 'last entry', None, _fingerprint(self._torn))
            self._write(record, who=f'graph:{source}')

    def _write(self, change: _Change, *, who: str, why: str = '') -> Entry:
        """Write and return the entry of a change.

        If the log does not end with an end of line, one is written before the entry. Raises
        `AuditError` if the log would become larger than `MAX_LOG`, and OSError if it cannot be
        written.
        """
        entry = Entry(self._count + 1, *change, self.last_hash, who=who, why=why)
        entry = replace(entry, hash=entry.digest())
        line = entry.line()
        if self.size + len(line) > MAX_LOG:
            raise AuditError(
                f'{self.path}: no room for an entry of {len(line)} bytes: a log may have at most '
                f'{MAX_LOG >> 20} MiB; name another file'
            )
        self._put(line if self._ended else b'\n' + line, entry)
        self._count, self.last_hash = entry.sequence, entry.hash
        self._torn, self._ended = b'', True
        return entry

    def _put(self, data: bytes, entry: Entry) -> None:
        """Append the line of an entry, sync the log to the disk, and write `LOG.head`.

        If one of these steps fails, the line is removed from the log if possible, and OSError is
        raised.
        """
        try:
            if os.write(self._file, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
            self._write_head(entry.sequence, entry.hash)
            self.size += len(data)
        except OSError:
            try:
                os.ftruncate(self._file, self.size)
            except OSError:
                self._altered = f'{self.path}: ends with an entry that could not be finished'
            raise
        finally:
            self._state = os.fstat(self._file)

    def _write_head(self, sequence: int, digest: str) -> None:
        head = head_path(self.path)
        following = head.with_name(head.name + '.next')
        with following.open('wb') as file:
            file.write(text := _head_line(sequence, digest))
            file.flush()
            os.fsync(file.fileno())
        os.replace(following, head)
        self._head = text
        # An error of the sync is ignored, because it only means that `LOG.head` may lack the last
        # entry after a power loss, which is allowed.
        with suppress(OSError):
            sync_folder(self.path.parent)


def _parse(line: bytes) -> Entry | None:
    """Return the entry of a line, or None if the line has another format or a wrong hash."""
    try:
        entry = Entry(**json.loads(line))
        good = entry.line() == line + b'\n' and entry.digest() == entry.hash
    except (ValueError, TypeError, RecursionError):
        return None
    return entry if good and type(entry.sequence) is int else None


def _last_hash(entries: Sequence[Entry]) -> str:
    return entries[-1].hash if entries else FIRST_PREVIOUS


def _records(entry: Entry, torn: bytes) -> bool:
    return entry.kind == TORN and entry.new == _fingerprint(torn)


def _fingerprint(torn: bytes) -> dict[str, object]:
    return {'bytes': len(torn), 'sha256': hashlib.sha256(torn).hexdigest()}


def _canonical(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, allow_nan=False, separators=(',', ':')).encode('ascii')


def _head_line(sequence: int, digest: str) -> bytes:
    return _canonical({'sequence': sequence, 'hash': digest}) + b'\n'

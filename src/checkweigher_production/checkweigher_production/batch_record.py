# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Record of a batch: a file with one line of JSON for each event of the batch.

The kinds of lines are begin, product (with its recipe), verdict, stop, filler, reset, broken and
end. Each line ends with the SHA-256 hash of the file up to this hash. Lines of older versions have
a checksum instead of the hash, or neither. NaN and infinities are written as NaN, Infinity and
-Infinity. A separate thread writes and syncs the lines, so that production does not wait for the
disk. If the disk is full, the thread retries until the lines are written. A record without an end
is continued after a restart.

The audit log contains the length and the hash of a record from each time that it was opened or
closed, and from each call of `RecordWriter.note` in between. A record is broken if it contradicts
the audit log, or if the hash of a line is wrong.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, is_dataclass
import errno
from functools import partial
import hashlib
import io
import json
import os
from pathlib import Path
import queue
import re
import threading
from typing import Any, TypeVar, get_type_hints
from urllib.parse import quote
import zlib

import numpy as np

from checkweigher_core.changes import RECORD
from checkweigher_core.printable import one_line
from checkweigher_core.records import Decision, FillerFeedback, Verdict, newer_fields
from checkweigher_core.state_files import replace_file
from checkweigher_production.audit_log import Entry
from checkweigher_production.recipes import product_of

SUFFIX = '.jsonl'
_LONGEST = 200  # largest number of characters of a file name without suffix
_RETRY = 1.0  # time in s between two attempts to write
_LONGEST_LINE = 2**16  # largest number of bytes in a line
_HASH = re.compile(rb',"hash":"([0-9a-f]{64})"}\n')  # pattern of the end of a line with a hash
_HASH_SIZE = 76  # number of bytes that `_HASH` matches.
# Values of `RecordState.event`.
BEGUN, CONTINUED, WRITTEN = 'begun', 'continued', 'written'
STOPPED, ENDED = 'stopped', 'ended'
_Record = TypeVar('_Record', Verdict, FillerFeedback)


class RecordError(ValueError):
    """Raised if a record cannot be used. The message names the file and the fault."""


def record_path(folder: Path, batch: str) -> Path:
    """Return the path of the record of a batch. Raises `RecordError` if the name is too long."""
    name = quote(batch, safe=' ') or 'unnamed'
    if len(name) > _LONGEST:
        rule = f'at most {_LONGEST} are allowed; all but A-Z, a-z and 0-9 count as 3 or more'
        raise RecordError(f'batch {one_line(batch, 40)!r}: {len(name)} characters, {rule}')
    return folder / f'{name}{SUFFIX}'


def records_in(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Return the paths of records without an end, by batch, and the faults of invalid records.

    Only the first line and the end of each file are read.
    """
    found: dict[str, Path] = {}
    faults = []
    for path in sorted(folder.glob(f'*{SUFFIX}')):
        try:
            begin = next(read_lines(path), None)
            if begin is None:
                faults.append(f'{path}: is empty')
            elif not _ends(path):
                if record_path(folder, batch := _begin(begin)['batch']) != path:
                    raise RecordError(f'{path}:1: is the record of {one_line(batch)!r}')
                found[batch] = path
        except (OSError, RecordError) as error:
            faults.append(str(error))
    return found, faults


def _ends(path: Path) -> bool:
    """Return whether the last complete line of a file is the end of a record."""
    with path.open('rb') as file:
        file.seek(max(0, path.stat().st_size - _LONGEST_LINE))
        *lines, _ = file.read().split(b'\n')
    return bool(lines) and lines[-1].startswith(b'{"kind":"end",')


@dataclass(frozen=True, slots=True)
class RecordState:
    """State of a batch record that is written to the audit log."""

    batch: str
    event: str  # BEGUN, CONTINUED, WRITTEN, STOPPED or ENDED
    sha256: str  # SHA-256 of the file, hexadecimal
    size: int = -1  # length of the file in bytes, -1 if unknown
    broken: str = ''  # reason why the record is broken, or empty
    time: str = ''  # time of the entry in the audit log, ISO 8601, or empty if not written yet

    @property
    def value(self) -> dict[str, str | int]:
        """Value of the entry in the audit log. Empty fields are left out."""
        names = 'event', 'size', 'sha256', 'broken'
        return {name: getattr(self, name) for name in names if getattr(self, name)}


def has_ended(value: Any) -> bool:
    """Return whether an audit log value, which may be None, states that a record has ended.

    In a log of an older version, the value of an ended record is a string.
    """
    return isinstance(value, str) or (isinstance(value, dict) and value.get('event') == ENDED)


def states_in(entries: Sequence[Entry], batch: str) -> list[RecordState]:
    """Return the states of the record of `batch` that audit log entries contain, oldest first."""
    own = [each for each in entries if (each.kind, each.subject) == (RECORD, batch)]
    found = []
    for entry in own:
        # In a log of an older version, the value is the hash of the ended record.
        new = entry.new if isinstance(entry.new, dict) else {'event': ENDED, 'sha256': entry.new}
        event, sha256, broken = (str(new.get(name, '')) for name in ('event', 'sha256', 'broken'))
        size = new.get('size')
        size = size if isinstance(size, int) else -1
        found.append(RecordState(batch, event, sha256, size, broken, entry.time))
    return found


def fault_of(data: bytes, states: Sequence[RecordState]) -> str:
    """Return the reason why a record is broken, or an empty string if it is not broken.

    `data` is the content of the file. `states` contains the states of the record in the audit log.
    """
    return _broken_line(data) or _contradicted(data, states)


def _broken_line(data: bytes) -> str:
    """Return a message on the first line that was changed or states a fault, or ''."""
    digest, is_chained = hashlib.sha256(), False
    for number, line in enumerate(io.BytesIO(data[: data.rfind(b'\n') + 1]), 1):
        digest.update(line[:-_HASH_SIZE])
        own = _HASH.fullmatch(line[-_HASH_SIZE:])
        is_chained = is_chained or own is not None
        if is_chained and (own is None or own[1].decode() != digest.hexdigest()):
            return f'line {number}: it or a line before it is not as it was written'
        if line.startswith(b'{"kind":"broken",'):
            return f'line {number}: the node product found the record broken'
        digest.update(line[-_HASH_SIZE:])
    return ''


def _contradicted(data: bytes, states: Sequence[RecordState]) -> str:
    """Return a message on the first contradiction between a record and the audit log, or ''."""
    for state in states:
        size = len(data) if state.size < 0 else state.size
        when = f'{state.event} {state.time}'.strip()
        if state.broken:
            return f'{when}: {state.broken}'
        if len(data) < size:
            return f'it has {len(data)} bytes, and had {size} ({when}): its end was removed'
        if hashlib.sha256(data[:size]).hexdigest() != state.sha256:
            return f'its first {size} bytes are not as they were ({when})'
    last = states[-1] if states else None
    if last is not None and last.event in (STOPPED, ENDED) and len(data) > last.size >= 0:
        return f'{len(data) - last.size} bytes were added after it was {last.event} {last.time}'
    return ''


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the values of each line of a record, without its hash or checksum.

    An incomplete last line, as after a power loss, is ignored. Raises `RecordError` if the file
    cannot be read, or if a line is not valid or has a wrong checksum. The hashes are not checked,
    so that a broken record is still readable.
    """
    try:
        with path.open('rb') as file:
            for number, line in enumerate(file, 1):
                if not line.endswith(b'\n'):
                    return
                try:
                    # An integer of more than 64 bits is invalid, because no ROS message can contain
                    # one.
                    values = json.loads(line, parse_int=lambda text: int(np.int64(text)))
                    begins = values['kind'] == 'begin'
                    checksum = values.pop('crc32', None)  # only in lines of older versions
                    values.pop('hash', None)
                except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
                    begins = number > 1
                if begins != (number == 1):
                    raise RecordError(f'{path}:{number}: is no line of the record of a batch')
                if checksum not in (None, _checksum(values)):
                    raise RecordError(f'{path}:{number}: is not as it was written')
                yield values
    except OSError as error:
        raise RecordError(f'{path}: {error.strerror or error}') from None


def read_events(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield the kind and the content of each line of a record.

    The content is a `Product`, `Verdict` or `FillerFeedback`, or a dict for all other kinds. Raises
    `RecordError` as `read_lines` does, or if a value is not valid.
    """
    for number, values in enumerate(read_lines(path), 1):
        kind = values.pop('kind')
        try:
            event = _EVENTS.get(kind, dict)(values)
        except (TypeError, ValueError, OverflowError) as error:
            raise RecordError(f'{path}:{number}: {error}') from None
        yield kind, event


def _begin(values: Mapping[str, Any]) -> Mapping[str, Any]:
    if not isinstance(batch := values.get('batch'), str):
        raise RecordError(f'batch: {batch!r} is not a name')
    return values


def _record_of(kind: type[_Record], values: Mapping[str, Any]) -> _Record:
    """Return an instance of `kind` with the values of a line.

    Values without a field in `kind` are ignored. Raises `RecordError` if a value cannot be used, or
    if a field is missing that is not one of `newer_fields`.
    """
    own, hints, newer = {}, get_type_hints(kind), newer_fields(kind)
    for each in fields(kind):
        if each.name in values:
            own[each.name] = _typed(hints[each.name], values[each.name], each.name)
        elif each.name not in newer:
            raise RecordError(f'{each.name} is missing')
    return kind(**own)


def _typed(hint: Any, value: Any, name: str) -> Any:
    if hint is Decision and value in Decision.__members__:
        return Decision[value]
    if hint == tuple[str, ...]:
        if isinstance(value, list) and {*map(type, value)} <= {str}:
            return tuple(value)
    elif hint is float and type(value) is int:
        return float(value)
    elif isinstance(value, hint) and isinstance(value, bool) == (hint is bool):
        return value
    raise RecordError(f'{name}: {value!r} cannot be used')


_EVENTS: dict[str, Callable[[Mapping[str, Any]], Any]] = {
    'begin': _begin,
    'product': product_of,
    'verdict': partial(_record_of, Verdict),
    'filler': partial(_record_of, FillerFeedback),
}


class RecordWriter:
    """Writer of the records of successive batches in the folder `folder`.

    A thread writes to the disk, in the order of the calls. Only `settle` and `close` wait for the
    thread. `states` is a queue of states for the audit log. `trouble` is the reason why lines
    cannot be written at present, or empty. Raises `RecordError` if the folder cannot be created.
    """

    def __init__(self, folder: Path) -> None:
        self.states: queue.SimpleQueue[RecordState] = queue.SimpleQueue()
        self.trouble = ''
        self._folder = folder
        self._closing, self._lost = threading.Event(), False
        # Only the thread of the executor uses the following attributes, so they need no lock.
        self._file: int | None = None
        self._batch, self._path = '', folder
        self._size, self._hash = 0, hashlib.sha256()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(f'{folder}: {error.strerror or error}') from None
        self._executor = ThreadPoolExecutor(1, 'batch record')

    def begin(self, batch: str, time: str, **others: object) -> None:
        """Begin the record of a batch, and end the record of the previous batch.

        `time` is written to both records, and `others` to the first line of the new record. If the
        batch already has a record, this record is continued unless it has ended. Raises
        `RecordError` if the name of the batch is too long.
        """
        line = line_of('begin', {'time': time, 'batch': batch, **others})
        # The new record is created before the old one ends, so that a batch is always in progress.
        self._submit(self._create, record_path(self._folder, batch), line)
        self.end(time)
        self._submit(self._open, batch, BEGUN, time)

    def resume(self, batch: str, time: str = '', states: Sequence[RecordState] = ()) -> None:
        """Continue the record of a batch, unless it has ended.

        `states` contains the states of the record in the audit log. If the record is broken, a line
        with the fault and the time `time` is added, unless the record has such a line already.
        """
        self._submit(self._open, batch, CONTINUED, time, states)

    def write(self, kind: str, values: object) -> None:
        """Append a line with a verdict, a stop request, feedback to the filler, or a mapping.

        `kind` is the kind of the line, such as 'verdict'. If no record is open, the line is
        ignored.
        """
        self._submit(self._append, line_of(kind, values))

    def settle(self, patience: float) -> None:
        """Wait until everything requested so far is written, but at most `patience` s."""
        with suppress(TimeoutError):
            self._executor.submit(int).result(patience)

    def note(self) -> None:
        """Add the present state of the record to `states`, if a record is open.

        The state in the audit log protects the lines written so far, even if power is lost before
        the record is closed.
        """
        self._submit(self._note)

    def end(self, time: str) -> None:
        """Write the last line of the record, which contains `time`, and close the record."""
        self.write('end', {'time': time})
        self._submit(self._release, ENDED)

    def close(self) -> None:
        """Write the remaining lines, and stop the thread. Lines that cannot be written are lost."""
        self._closing.set()
        self._executor.submit(self._release, STOPPED)
        self._executor.shutdown()

    def _submit(self, step: Callable[..., object], *arguments: object) -> None:
        self._executor.submit(self._persist, step, *arguments)

    def _persist(self, step: Callable[..., object], *arguments: object) -> None:
        """Repeat a step that writes to the disk until it succeeds or the writer is closed.

        An OSError of the step is stored in `trouble`.
        """
        while not self._lost:
            try:
                step(*arguments)
                self.trouble = ''
                return
            except OSError as error:
                self.trouble = f'{error.filename or self._folder}: {error.strerror or error}'
                # If a line is lost, no later line may be written.
                self._lost = self._closing.wait(_RETRY)

    def _create(self, path: Path, line: bytes) -> None:
        if not path.exists():
            replace_file(path, [_with_hash(line, hashlib.sha256())])

    def _open(self, batch: str, event: str, time: str, states: Sequence[RecordState] = ()) -> None:
        """Open the record of a batch, and add its state to the attribute `states`.

        An incomplete last line is removed. If the record contradicts its `states` in the audit log
        or is broken otherwise, a line of the kind 'broken' is added, unless there is one already. A
        record that has ended is not opened.
        """
        self._batch, self._path = batch, record_path(self._folder, batch)
        data = self._path.read_bytes()
        broken = fault_of(data, states)
        there = data[: data.rfind(b'\n') + 1]
        self._size, self._hash = len(there), hashlib.sha256(there)
        if _ends(self._path):
            self._tell(ENDED, broken)
            return
        self._file = os.open(self._path, os.O_RDWR | os.O_APPEND)
        os.ftruncate(self._file, self._size)
        if broken and b'\n{"kind":"broken",' not in there:
            self._append(line_of('broken', {'time': time, 'reason': broken}))
        self._tell(event, broken)

    def _append(self, line: bytes) -> None:
        """Append a line with its hash, and sync the file. If no file is open, do nothing.

        If the line cannot be written, OSError is raised, and the file is unchanged.
        """
        if self._file is None:
            return
        line = _with_hash(line, self._hash)
        try:
            if os.write(self._file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, self._size)
            raise
        self._hash.update(line)
        self._size += len(line)

    def _tell(self, event: str, broken: str = '') -> None:
        digest = self._hash.hexdigest()
        self.states.put(RecordState(self._batch, event, digest, self._size, broken))

    def _note(self) -> None:
        if self._file is not None:
            self._tell(WRITTEN)

    def _release(self, event: str) -> None:
        if self._file is not None:
            self._tell(event)
            os.close(self._file)
            self._file = None


def line_of(kind: str, values: object) -> bytes:
    """Return the JSON line for a dataclass instance or a mapping, without hash and closing brace.

    The hash and the closing brace are added when the line is written to the file.
    """
    given: Any = asdict(values) if is_dataclass(values) else values  # type: ignore[arg-type]
    line = {'kind': kind} | {n: v.name if isinstance(v, Decision) else v for n, v in given.items()}
    return _compact(line)[:-1]


def _with_hash(line: bytes, before: 'hashlib._Hash') -> bytes:
    """Complete a line of `line_of` with the hash of the file so far, a brace and a line feed.

    `before` is the hash object of all earlier lines of the file. It is not changed.
    """
    digest = before.copy()
    digest.update(line)
    return line + b',"hash":"%s"}\n' % digest.hexdigest().encode()


def _checksum(values: Mapping[str, Any]) -> int:
    return zlib.crc32(_compact(values))


def _compact(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, separators=(',', ':')).encode('ascii')

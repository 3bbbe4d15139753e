# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Record of a batch: a file with one line of JSON for each event of the batch.

The kinds of lines are begin, product (with its recipe), verdict, stop, filler, reset and end. Each
line has its kind and, except in old files, a checksum. NaN and infinities are written as NaN,
Infinity and -Infinity. A separate thread writes and syncs the lines, so that production does not
wait for the disk. If the disk is full, the thread retries until the lines are written. A record
without an end is continued after a restart.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields, is_dataclass
import errno
from functools import partial
import hashlib
import json
import os
from pathlib import Path
import queue
import threading
from typing import Any, TypeVar, get_type_hints
from urllib.parse import quote
import zlib

import numpy as np

from checkweigher_core.printable import one_line
from checkweigher_core.records import BatchResult, Decision, FillerFeedback, Verdict
from checkweigher_core.state_files import replace_file
from checkweigher_production.recipes import product_of

SUFFIX = '.jsonl'
_LONGEST = 200  # largest number of characters of a batch name in a file name
_RETRY = 1.0  # time between two attempts to write in s
_LONGEST_LINE = 2**16  # bytes
_NEWER = ('station', 'station_at')  # fields of a verdict that are missing in old files
_Record = TypeVar('_Record', Verdict, FillerFeedback)


class RecordError(ValueError):
    """Error for a record that cannot be used. The message names the file and the fault."""


def record_path(folder: Path, batch: str) -> Path:
    """Return the path of the record of a batch. Raises `RecordError` if the name is too long."""
    name = quote(batch, safe=' ') or 'unnamed'
    if len(name) > _LONGEST:
        rule = f'at most {_LONGEST}, of which others than A-Z, a-z and 0-9 count 3 or more'
        raise RecordError(f'batch {one_line(batch, 40)!r}: {len(name)} characters, {rule}')
    return folder / f'{name}{SUFFIX}'


def records_in(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Return the paths of the records without an end by batch, and the faults of invalid records.

    Only the first line and the last line of each file are read.
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


def ended_record(path: Path) -> BatchResult | None:
    """Return the result in a record that has an end, with the stamp 0, or None without an end."""
    begin = next(read_lines(path), None)
    if begin is None or not _ends(path):
        return None
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return BatchResult(0, _begin(begin)['batch'], str(path.resolve()), digest)


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a record. An incomplete last line, as after a power loss, is ignored.

    Raises `RecordError` if the file cannot be read or a line is not valid.
    """
    try:
        with path.open('rb') as file:
            for number, line in enumerate(file, 1):
                if not line.endswith(b'\n'):
                    return
                try:
                    # Integers in ROS messages have at most 64 bits.
                    values = json.loads(line, parse_int=lambda text: int(np.int64(text)))
                    begins = values['kind'] == 'begin'
                    checksum = values.pop('crc32', None)
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
    """Yield kind and content of each line.

    The content is a `Product`, `Verdict` or `FillerFeedback`, or a dict for all other kinds. The
    exceptions are as in `read_lines`.
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
    """Return a record. Unknown fields are ignored. Only fields in `_NEWER` may be missing."""
    own, hints = {}, get_type_hints(kind)
    for each in fields(kind):
        if each.name in values:
            own[each.name] = _typed(hints[each.name], values[each.name], each.name)
        elif each.name not in _NEWER:
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
    """Writer of the records of successive batches.

    `ended` is a queue of the results of complete records. `trouble` is the reason why lines cannot
    be written at present, or empty.
    """

    def __init__(self, folder: Path) -> None:
        self.ended: queue.SimpleQueue[BatchResult] = queue.SimpleQueue()
        self.trouble = ''
        self._folder = folder
        self._closing, self._lost = threading.Event(), False
        # Only the thread of the executor uses the open file and its size and hash.
        self._file: int | None = None
        self._batch, self._path = '', folder
        self._size, self._hash = 0, hashlib.sha256()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(f'{folder}: {error.strerror or error}') from None
        self._executor = ThreadPoolExecutor(1, 'batch record')

    def begin(self, batch: str, time: str, **others: object) -> None:
        """Begin the record of a batch, and end the record of the previous batch."""
        line = line_of('begin', {'time': time, 'batch': batch, **others})
        # The new record is created before the old one ends, so that a batch is always in progress.
        self._submit(self._create, record_path(self._folder, batch), line)
        self.end(time)
        self.resume(batch)

    def resume(self, batch: str) -> None:
        """Continue the record of a batch."""
        self._submit(self._open, batch)

    def write(self, kind: str, values: object) -> None:
        """Append a line with a verdict, a stop request, feedback to the filler, or a mapping."""
        self._submit(self._append, line_of(kind, values))

    def end(self, time: str) -> None:
        """End the record."""
        self.write('end', {'time': time})
        self._submit(self._finish)

    def close(self) -> None:
        """Write the remaining lines, and stop the thread. Lines that cannot be written are lost."""
        self._closing.set()
        self._executor.submit(self._release)
        self._executor.shutdown()

    def _submit(self, step: Callable[..., object], *arguments: object) -> None:
        self._executor.submit(self._persist, step, *arguments)

    def _persist(self, step: Callable[..., object], *arguments: object) -> None:
        """Repeat a step that writes to the disk until it succeeds or the writer is closed."""
        while not self._lost:
            try:
                step(*arguments)
                self.trouble = ''
                return
            except OSError as error:
                self.trouble = f'{error.filename or self._folder}: {error.strerror or error}'
                self._lost = self._closing.wait(_RETRY)  # after a lost line, none may be written

    def _create(self, path: Path, line: bytes) -> None:
        if not path.exists():
            replace_file(path, [line])

    def _open(self, batch: str) -> None:
        """Open the record of a batch, and remove an incomplete last line."""
        self._batch, self._path = batch, record_path(self._folder, batch)
        self._file = os.open(self._path, os.O_RDWR | os.O_APPEND)
        there = self._path.read_bytes()
        there = there[: there.rfind(b'\n') + 1]
        os.ftruncate(self._file, len(there))
        self._size, self._hash = len(there), hashlib.sha256(there)

    def _append(self, line: bytes) -> None:
        """Append a line. If that fails, the file is unchanged."""
        if self._file is None:
            return
        try:
            if os.write(self._file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, self._size)
            raise
        self._hash.update(line)
        self._size += len(line)

    def _finish(self) -> None:
        if self._file is not None:
            self.ended.put(
                BatchResult(0, self._batch, str(self._path.resolve()), self._hash.hexdigest())
            )
            self._release()

    def _release(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None


def line_of(kind: str, values: object) -> bytes:
    """Return the line for a record or a mapping of values."""
    given: Any = asdict(values) if is_dataclass(values) else values  # type: ignore[arg-type]
    line = {'kind': kind} | {n: v.name if isinstance(v, Decision) else v for n, v in given.items()}
    return _compact({**line, 'crc32': _checksum(line)}) + b'\n'


def _checksum(values: Mapping[str, Any]) -> int:
    return zlib.crc32(_compact(values))


def _compact(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, separators=(',', ':')).encode('ascii')

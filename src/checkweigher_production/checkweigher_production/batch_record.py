# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of a batch: a file with a line of JSON for each event of the batch.

The lines are begin, product (the recipe), verdict, stop, filler, reset and end, each with its kind.
NaN and infinities are written as NaN, Infinity and -Infinity, as in Python. A thread of its own
writes and syncs the lines, so that the line does not wait for the disk. If the disk is full, it
tries again until the lines are written. A record without an end is continued after a restart.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields, is_dataclass
import errno
import hashlib
import json
import os
from pathlib import Path
import queue
import threading
from typing import Any
from urllib.parse import quote

from checkweigher_core.printable import one_line
from checkweigher_core.records import BatchResult, Decision, Verdict

SUFFIX = '.jsonl'
_LONGEST = 200  # characters of a batch in the name of a file
_RETRY = 1.0  # s


class RecordError(ValueError):
    """A record that cannot be used. The message names the file, the place and the fault."""


def record_path(folder: Path, batch: str) -> Path:
    """Return the file of the record of a batch; `RecordError` if its name would be too long."""
    name = quote(batch, safe=' ') or 'unnamed'
    if len(name) > _LONGEST:
        rule = f'at most {_LONGEST}, of which others than A-Z, a-z and 0-9 count 3 or more'
        raise RecordError(f'batch {one_line(batch, 40)!r}: {len(name)} characters, {rule}')
    return folder / f'{name}{SUFFIX}'


def last_record(folder: Path) -> Path | None:
    """Return the record that was written last, None if there is none."""
    return max(folder.glob(f'*{SUFFIX}'), key=lambda path: path.stat().st_mtime_ns, default=None)


def ended_record(path: Path) -> BatchResult | None:
    """Return the result of a batch that has ended, with the stamp 0, else None."""
    begin = last = None
    for last in read_lines(path):
        begin = begin or last
    if begin is None or last is None or last['kind'] != 'end':
        return None
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return BatchResult(0, str(begin['batch']), str(path.resolve()), digest)


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a record, except a last line that a power loss left incomplete.

    Raises `RecordError` if the file cannot be read or a line does not belong to a record.
    """
    try:
        with path.open('rb') as file:
            for number, line in enumerate(file, 1):
                if not line.endswith(b'\n'):
                    return
                try:
                    values = json.loads(line)
                    begins = values['kind'] == 'begin'
                except (ValueError, TypeError, KeyError, RecursionError):
                    begins = number > 1
                if begins != (number == 1):
                    raise RecordError(f'{path}:{number}: is no line of the record of a batch')
                yield values
    except OSError as error:
        raise RecordError(f'{path}: {error.strerror or error}') from None


def verdict_of(values: Mapping[str, Any]) -> Verdict:
    """Return the verdict of a line; `RecordError` if it is not one.

    Fields that the version of the record did not have get their defaults.
    """
    try:
        own = {each.name: values[each.name] for each in fields(Verdict) if each.name in values}
        own |= {'decision': Decision[own['decision']], 'reasons': tuple(own['reasons'])}
        return Verdict(**own)
    except (KeyError, TypeError) as error:
        raise RecordError(f'a verdict of a record lacks or misuses {error}') from None


class RecordWriter:
    """Writer of the records of a lane, one batch after the other.

    `ended` is the queue of complete records. `trouble` is the reason why nothing can be written
    now, else empty.
    """

    def __init__(self, folder: Path) -> None:
        self.ended: queue.SimpleQueue[BatchResult] = queue.SimpleQueue()
        self.trouble = ''
        self._folder = folder
        self._closing = threading.Event()
        # Used by the thread of the executor: the open file, its size and its hash.
        self._file: int | None = None
        self._batch, self._path = '', folder
        self._size, self._hash = 0, hashlib.sha256()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(f'{folder}: {error.strerror or error}') from None
        self._executor = ThreadPoolExecutor(1, 'batch record')

    def begin(self, batch: str, time: str, **others: object) -> None:
        """Begin the record of a batch, or continue it if it exists."""
        line = line_of('begin', {'time': time, 'batch': batch, **others})
        self._submit(self._open, batch)
        self._submit(self._append, line, True)

    def write(self, kind: str, values: object) -> None:
        """Append a line: a verdict, a stop request, feedback to the filler, or a mapping."""
        self._submit(self._append, line_of(kind, values))

    def end(self, time: str) -> None:
        """End the record."""
        self.write('end', {'time': time})
        self._submit(self._finish)

    def close(self) -> None:
        """Write the remaining lines and stop. Lines that the disk does not take are lost."""
        self._closing.set()
        self._executor.submit(self._release)
        self._executor.shutdown()

    def _submit(self, step: Callable[..., object], *arguments: object) -> None:
        self._executor.submit(self._persist, step, *arguments)

    def _persist(self, step: Callable[..., object], *arguments: object) -> None:
        """Repeat a step that writes to the disk until it succeeds or the writer is closed."""
        while True:
            try:
                step(*arguments)
                self.trouble = ''
                return
            except OSError as error:
                self.trouble = f'{error.filename or self._folder}: {error.strerror or error}'
                if self._closing.wait(_RETRY):
                    self._release()  # no line may follow a lost one
                    return

    def _open(self, batch: str) -> None:
        """Open the file, and remove a last line that a power loss left incomplete."""
        self._batch, self._path = batch, record_path(self._folder, batch)
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        there = self._path.read_bytes()
        there = there[: there.rfind(b'\n') + 1]
        os.ftruncate(self._file, len(there))
        self._size, self._hash = len(there), hashlib.sha256(there)

    def _append(self, line: bytes, first: bool = False) -> None:
        """Append a whole line or nothing; a `first` line only to an empty file."""
        if self._file is None or (first and self._size):
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
            path = str(self._path.resolve())
            self.ended.put(BatchResult(0, self._batch, path, self._hash.hexdigest()))
            self._release()

    def _release(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None


def line_of(kind: str, values: object) -> bytes:
    """Return the line of a record or of a mapping of values."""
    own: Any = asdict(values) if is_dataclass(values) else values  # type: ignore[arg-type]
    own = {n: v.name if isinstance(v, Decision) else v for n, v in own.items()}
    return json.dumps({'kind': kind, **own}, separators=(',', ':')).encode('ascii') + b'\n'

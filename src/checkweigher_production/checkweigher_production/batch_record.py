# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of a batch: a file with a line of JSON for everything that happened in it.

The lines are begin, product (the recipe), verdict, stop, filler, reset and end, each with its kind.
NaN and infinities are written as NaN, Infinity and -Infinity, as in Python. A thread of
its own writes and syncs, so that no disk keeps the line waiting; a disk that is full is tried again
until it takes the lines. The record of a batch that has no end goes on after a restart.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields
import errno
import hashlib
import json
import os
from pathlib import Path
import queue
import threading
from typing import Any
from urllib.parse import quote

from checkweigher_core.records import Decision, FillerFeedback, StopRequest, Verdict

SUFFIX = '.jsonl'
_RETRY = 1.0  # s


class RecordError(ValueError):
    """A record that cannot be used; one line that says which, where and why."""


@dataclass(frozen=True, slots=True)
class EndedRecord:
    """A record that is complete, and the SHA-256 of its file."""

    batch: str
    path: Path
    sha256: str


def record_path(folder: Path, batch: str) -> Path:
    """Return the file of the record of a batch."""
    return folder / f'{quote(batch, safe=" ") or "unnamed"}{SUFFIX}'


def last_record(folder: Path) -> Path | None:
    """Return the record that was written last, None if there is none."""
    found = sorted(folder.glob(f'*{SUFFIX}'), key=lambda path: path.stat().st_mtime_ns)
    return found[-1] if found else None


def ended_record(path: Path) -> EndedRecord | None:
    """Return a record with its hash if its batch has ended."""
    begin = last = None
    for last in read_lines(path):
        begin = begin or last
    if begin is None or last is None or last['kind'] != 'end':
        return None
    return EndedRecord(str(begin['batch']), path, hashlib.sha256(path.read_bytes()).hexdigest())


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a record; one that a power cut has left without its end is no line.

    Raises
    ------
    RecordError
        If the file cannot be read or a line is none of a record.
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
    """Return the verdict of a line; `RecordError` if it is none."""
    try:
        own = {entry.name: values[entry.name] for entry in fields(Verdict)}
        decision = Decision[own.pop('decision')]
        reasons = tuple(map(str, own.pop('reasons')))
        return Verdict(decision=decision, reasons=reasons, **own)
    except (KeyError, TypeError) as error:
        raise RecordError(f'a verdict of a record lacks or misuses {error}') from None


class RecordWriter:
    """Writer of the records of a lane, one batch after the other.

    `ended` has each record that is complete; `trouble` is why nothing can be written at present,
    empty if it can.
    """

    def __init__(self, folder: Path) -> None:
        self.ended: queue.SimpleQueue[EndedRecord] = queue.SimpleQueue()
        self.trouble = ''
        self._folder = folder
        self._closing = threading.Event()
        # What follows belongs to the thread of the executor: the open file and what it holds.
        self._file: int | None = None
        self._batch, self._path = '', folder
        self._size, self._hash = 0, hashlib.sha256()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(f'{folder}: {error.strerror or error}') from None
        self._executor = ThreadPoolExecutor(1, 'batch record')

    def begin(self, batch: str, time: str, **others: object) -> None:
        """Begin the record of a batch, or go on with it if it is there."""
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
        """Write what is left and stop; what a disk does not take now is lost."""
        self._closing.set()
        self._executor.submit(self._release)
        self._executor.shutdown()

    def _submit(self, step: Callable[..., object], *arguments: object) -> None:
        self._executor.submit(self._persist, step, *arguments)

    def _persist(self, step: Callable[..., object], *arguments: object) -> None:
        """Do what the disk may refuse, again and again until it is done or the writer closes."""
        while True:
            try:
                step(*arguments)
                self.trouble = ''
                return
            except OSError as error:
                self.trouble = f'{error.filename or self._folder}: {error.strerror or error}'
                if self._closing.wait(_RETRY):
                    self._release()  # no later line may follow on one that is lost
                    return

    def _open(self, batch: str) -> None:
        """Open the file, without an end that a power cut has left unfinished."""
        self._batch, self._path = batch, record_path(self._folder, batch)
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        there = self._path.read_bytes()
        there = there[: there.rfind(b'\n') + 1]
        os.ftruncate(self._file, len(there))
        self._size, self._hash = len(there), hashlib.sha256(there)

    def _append(self, line: bytes, first: bool = False) -> None:
        """Append a line, whole or not at all; one that is to be the `first` only if it is."""
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
            self.ended.put(EndedRecord(self._batch, self._path, self._hash.hexdigest()))
            self._release()

    def _release(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None


def line_of(kind: str, values: object) -> bytes:
    """Return the line of something that happened."""
    if isinstance(values, Verdict | StopRequest | FillerFeedback):
        values = asdict(values)
    assert isinstance(values, dict)
    if isinstance(values.get('decision'), Decision):
        values['decision'] = values['decision'].name
    return json.dumps({'kind': kind, **values}, separators=(',', ':')).encode('ascii') + b'\n'

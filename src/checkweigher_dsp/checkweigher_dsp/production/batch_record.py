# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of a batch: a file with a line of JSON for everything that happened in it.

The lines are begin, product (the recipe), verdict, stop, filler, reset and end, each with its kind.
NaN and infinities are written as NaN, Infinity and -Infinity, as in Python. A thread of
its own encodes, writes and syncs, so that no disk keeps the line waiting; a disk that is full is
tried again until it takes the lines. The record of a batch that has no end goes on after a restart.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
import errno
import hashlib
import json
import os
from pathlib import Path
import queue
import threading
from typing import Any, Final
from urllib.parse import quote

from checkweigher_dsp.input_files import open_input
from checkweigher_dsp.records import Decision, FillerFeedback, StopRequest, Verdict

SUFFIX = '.jsonl'
_RETRY = 1.0  # s
_MAX_LINE = 2**20  # bytes
_LARGEST = 2**33  # of a file
_STOP: Final = None


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
        with open_input(path, _LARGEST) as file:
            for number, line in enumerate(file, 1):
                if not line.endswith(b'\n'):
                    return
                yield _parsed(line, f'{path}:{number}', first=number == 1)
    except OSError as error:
        raise RecordError(f'{path}: {error.strerror or error}') from None


def _parsed(line: bytes, place: str, *, first: bool) -> dict[str, Any]:
    try:
        values = json.loads(line) if len(line) <= _MAX_LINE else None
    except (ValueError, RecursionError):
        values = None
    kind = values.get('kind') if isinstance(values, dict) else None
    if isinstance(values, dict) and isinstance(kind, str) and first == (kind == 'begin'):
        return values
    raise RecordError(f'{place}: is no line of the record of a batch')


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
        self._todo: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._closing = threading.Event()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(f'{folder}: {error.strerror or error}') from None
        self._thread = threading.Thread(target=self._run, name='batch record', daemon=True)
        self._thread.start()

    def begin(self, batch: str, time: str, **others: object) -> None:
        """Begin the record of a batch, or go on with it if it is there."""
        self._todo.put(('begin', batch, {'time': time, 'batch': batch, **others}))

    def write(self, kind: str, values: object) -> None:
        """Append a line: a verdict, a stop request, feedback to the filler, or a mapping."""
        self._todo.put((kind, None, values))

    def end(self, time: str, **others: object) -> None:
        """End the record."""
        self._todo.put(('end', None, {'time': time, **others}))

    def close(self) -> None:
        """Write what is left and stop; what a disk does not take now is lost."""
        self._closing.set()
        self._todo.put(_STOP)
        self._thread.join()

    def _run(self) -> None:
        file: _RecordFile | None = None
        while True:
            steps = [self._todo.get()]
            while not self._todo.empty():
                steps.append(self._todo.get())
            for step in steps:
                if step is _STOP:
                    if file is not None:
                        self._try(file.flush)
                        file.close()
                    return
                kind, batch, values = step
                if kind == 'begin':
                    file = _RecordFile(record_path(self._folder, batch), batch)
                    if self._try(file.open) and not file.size:
                        file.add(kind, values)
                elif file is not None:
                    file.add(kind, values)
                if kind == 'end' and file is not None:
                    if self._try(file.flush):
                        self.ended.put(EndedRecord(file.batch, file.path, file.sha256))
                    file.close()
                    file = None
            if file is not None:
                self._try(file.flush)

    def _try(self, work: Any) -> bool:
        """Do what the disk may refuse, again and again until it is done or the writer closes."""
        while True:
            try:
                work()
                self.trouble = ''
                return True
            except OSError as error:
                self.trouble = f'{error.filename or self._folder}: {error.strerror or error}'
                if self._closing.wait(_RETRY):
                    return False


class _RecordFile:
    """A record that is open for appending."""

    def __init__(self, path: Path, batch: str) -> None:
        self.path, self.batch = path, batch
        self.size = 0
        self._file: int | None = None
        self._hash = hashlib.sha256()
        self._waiting = b''

    @property
    def sha256(self) -> str:
        return self._hash.hexdigest()

    def open(self) -> None:
        """Open the file, without an end that a power cut has left unfinished."""
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        there = self.path.read_bytes()
        there = there[: there.rfind(b'\n') + 1]
        os.ftruncate(self._file, len(there))
        self.size, self._hash = len(there), hashlib.sha256(there)

    def add(self, kind: str, values: object) -> None:
        self._waiting += line_of(kind, values)

    def flush(self) -> None:
        """Append what waits, all or none, and have it on the disk."""
        if self._file is None or not self._waiting:
            return
        try:
            if os.write(self._file, self._waiting) < len(self._waiting):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, self.size)
            raise
        self._hash.update(self._waiting)
        self.size += len(self._waiting)
        self._waiting = b''

    def close(self) -> None:
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

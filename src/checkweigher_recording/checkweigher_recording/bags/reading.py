# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading a ROS 2 bag into records: MCAP or SQLite, the whole bag or a clear error."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from checkweigher_dsp.records import NANOSECONDS
from checkweigher_dsp.ros.ports import LOAD_CELL_INFO, Port
from checkweigher_recording.bags.bounds import MOST_TOPICS, qos_unread
from checkweigher_recording.bags.definitions import BagError, check_definition
from checkweigher_recording.bags.integrity import check_mcap
from checkweigher_recording.bags.lane_messages import LaneMessages, OutOfOrderError
from checkweigher_recording.bags.lanes import Lane, choose_lane
from checkweigher_recording.bags.sqlite import (
    NO_CHECK_SUMS,
    check_sqlite,
    doubtful_blocks,
    sample_rate,
)
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts
from checkweigher_recording.bags.unpacking import (
    files_of,
    read_metadata,
    unpack_message,
    unpacked,
)
from checkweigher_recording.progress import with_progress
from checkweigher_recording.recording import BlockColumns, Recording

_RATE_TOLERANCE = 0.1
T = TypeVar('T')


def read_bag(path: Path, namespace: str | None = None, *, progress: bool = False) -> Recording:
    """Read one lane of a bag.

    Parameters
    ----------
    path : Path
        Folder of a bag, or a single ``.mcap`` or ``.db3`` file. A folder without ``metadata.yaml``
        is a recording that broke off: what is there of its ``.mcap`` files is read.
    namespace : str or None
        Of the lane; None if the bag has only one.
    progress : bool
        Whether to show a bar on a terminal if it takes more than a second.

    Returns
    -------
    Recording
        The events in canonical order; their order in the bag does not matter. `unfinished` if the
        recording broke off.

    Raises
    ------
    BagError
        If the bag is missing, damaged, incomplete or foreign. Of a file that is said to be whole,
        and of one with a hole, no part is read.

    Notes
    -----
    Check sums are checked where the file has them; some writers leave them out. The numbers of
    messages must agree wherever the bag states them.
    """
    with bag_errors(path), _opened(path, namespace) as lane:
        return _read_whole(path, lane, progress)


def over_stretches(
    work: Callable[[Iterable[Recording]], T], path: Path, namespace: str | None = None, *,
    progress: bool = False,
) -> T:  # fmt: skip
    """Return what `work` makes of the stretches of a bag.

    It is called again, with the whole bag as one stretch, where the messages are too far out of
    order for stretches. Parameters and errors are those of `read_bag`.
    """
    try:
        return work(read_stretches(path, namespace, progress=progress))
    except OutOfOrderError:
        return work([read_bag(path, namespace, progress=progress)])


def _read_whole(path: Path, lane: '_OpenLane', progress: bool) -> Recording:
    messages = LaneMessages(path)
    for message in with_progress(lane.messages(), 'reading', lane.count, shown=progress):
        messages.take(*message)
    lane.check_numbers(messages.numbers)
    if lane.is_sqlite:
        messages.check_stamps()
        return _without_doubtful(path, messages.rest())
    recording = messages.rest()
    return replace(recording, unfinished=lane.unfinished(_Span.of(recording)))


def read_stretches(
    path: Path, namespace: str | None = None, *, progress: bool = False
) -> Iterator[Recording]:
    """Read one lane of a bag in stretches of a minute or so, in memory that does not grow.

    One after the other they have all events that `read_bag` returns, in the same order. The first
    one has samples; `unfinished` and `doubt` are those of the last one, and the end of a bag may
    show that all of it is not to be used. An SQLite bag is one stretch: what is doubtful in it
    shows beside all the rest. Parameters and errors are those of `read_bag`.

    Raises
    ------
    OutOfOrderError
        If a message is logged more than a minute after others with later stamps: `read_bag` puts
        any order right.
    """
    with bag_errors(path), _opened(path, namespace) as lane:
        if lane.is_sqlite:
            yield _read_whole(path, lane, progress)
            return
        messages = LaneMessages(path)
        if cell := lane.first(LOAD_CELL_INFO):
            messages.take_cell(cell)
        span: _Span | None = None
        for message in with_progress(lane.messages(), 'reading', lane.count, shown=progress):
            messages.take(*message)
            if (stretch := messages.stretch()) is not None:
                span = _Span.of(stretch, span)
                yield stretch
        lane.check_numbers(messages.numbers)
        rest = messages.rest()
        yield replace(rest, unfinished=lane.unfinished(_Span.of(rest, span)))


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """Turn any exception of a parser on strange bytes into one line."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        where = error.filename or path
        raise BagError(f'{where}: cannot be read: {error.strerror or error}') from error
    # Damaged bytes can lead a parser anywhere, so no list of its exceptions would be complete.
    except Exception as error:
        text = ' '.join(str(error).split()) or type(error).__name__
        raise BagError(f'{path}: damaged: {text}; record it again or restore it') from error


def _information(path: Path) -> dict[str, Any]:
    """Return what a folder says of its files; of a file, check what can be seen from outside."""
    if not path.exists():
        raise BagError(f'{path}: there is no such file or folder')
    if not path.is_dir():
        if path.suffix not in ('.mcap', '.db3'):
            raise BagError(f'{path}: not a bag: neither a folder nor a .mcap or .db3 file')
        return {}
    if not (path / 'metadata.yaml').exists():
        raise BagError(f'{path}: not a bag: it has neither metadata.yaml nor an .mcap file')
    return read_metadata(path)


@contextmanager
def _opened(path: Path, namespace: str | None) -> Iterator['_OpenLane']:
    """Have one lane of a bag open, whose files are checked."""
    if parts := unfinished_parts(path):
        bag = UnfinishedBag(parts)
        if bag.damage:
            raise BagError(
                f'{path}: damaged: {bag.damage}; restore it, or "checkweigher recover" saves what '
                'is before it'
            )
        if not bag.message_count:
            raise BagError(f'{path}: the recording broke off before anything of it was written')
        yield _OpenLane(path, bag, namespace)
        return
    information = _information(path)
    with unpacked(path, information) as folder:
        for file in files_of(folder, _information(folder)) if path.is_dir() else [path]:
            check = check_sqlite if file.suffix == '.db3' else check_mcap
            check(file)
        reader = Reader(folder)
        with qos_unread():
            reader.open()
        try:
            yield _OpenLane(path, reader, namespace)
        finally:
            reader.close()


@dataclass(frozen=True, slots=True)
class _Span:
    """Begin of the first block and of the last one, ns, and the length of that one in s."""

    begin: int
    last: int
    length: float

    @classmethod
    def of(cls, recording: Recording, before: '_Span | None' = None) -> '_Span':
        """Return the span of a recording, which goes on with one before."""
        blocks = BlockColumns.of(recording.blocks)
        if before is not None and not len(blocks):
            return before
        last = int(np.searchsorted(blocks.stamps, blocks.stamps[-1]))
        length = float(blocks.lengths[last]) / recording.load_cell.sample_rate
        begin = int(blocks.stamps[0]) if before is None else before.begin
        return cls(begin, int(blocks.stamps[last]), length)

    @property
    def duration(self) -> float:
        """Length of the whole, s."""
        return self.length + (self.last - self.begin) / NANOSECONDS


class _OpenLane:
    """One lane of a bag that is open."""

    def __init__(self, path: Path, reader: Reader | UnfinishedBag, namespace: str | None) -> None:
        if len(reader.connections) > MOST_TOPICS:
            raise BagError(f'{path}: has more than {MOST_TOPICS} topics; record those of the lane')
        self._path, self._reader = path, reader
        self._lane = choose_lane(path, reader.connections, namespace)
        for connection, port in self._lane:
            check_definition(path, connection, port)
        self.count = sum(connection.msgcount for connection, _ in self._lane)
        self._packed = False  # each message by itself
        if isinstance(reader, Reader) and isinstance(reader.storage, DirectoryReader):
            # rosbags would unpack a message of any size.
            self._packed = reader.storage.metadata.compression_mode == 'message'
            reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)

    @property
    def is_sqlite(self) -> bool:
        """Whether a file of the bag is an SQLite database."""
        if isinstance(self._reader, UnfinishedBag):
            return False
        storage: Any = self._reader.storage
        parts: list[Any] = storage.storages if isinstance(storage, DirectoryReader) else [storage]
        return any(part.path.name.endswith('.db3') for part in parts)

    def messages(self) -> Iterator[tuple[str, Port, int, bytes]]:
        """Yield topic, port, time of logging in ns and data of each message, unpacked."""
        ports = {connection.topic: port for connection, port in self._lane}
        for connection, logged, data in self._stored([one for one, _ in self._lane]):
            yield connection.topic, ports[connection.topic], logged, data

    def first(self, port: Port) -> bytes | None:
        """Return the message of a port that was logged first, None if there is none."""
        connections = [connection for connection, own in self._lane if own is port]
        # Of no connections the reader would give all messages.
        found = self._stored(connections) if connections else iter(())
        return next((data for _, _, data in found), None)

    def _stored(self, connections: Sequence[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of some connections, unpacked."""
        for connection, logged, data in self._reader.messages(connections):
            yield connection, logged, unpack_message(data) if self._packed else data

    def check_numbers(self, read: Mapping[str, int]) -> None:
        """Check that all messages have been read that the bag says it holds."""
        if isinstance(self._reader, Reader):
            _check_numbers(self._path, self._reader, read, self._lane)

    def unfinished(self, span: _Span) -> str:
        """Return one line on how far a recording was read that broke off, empty of another one."""
        if isinstance(self._reader, Reader):
            return ''
        return (
            f'{self._path}: the recording broke off, or is still going on; read up to '
            f'{span.duration:.1f} s ({self._reader.message_count} messages)'
        )


def _without_doubtful(path: Path, recording: Recording) -> Recording:
    """Return a recording of an SQLite bag without blocks of samples that may be damaged.

    An item is a FAULT where samples of its window are missing.
    """
    blocks, stated = BlockColumns.of(recording.blocks), recording.load_cell.sample_rate
    found = sample_rate(blocks)
    if abs(found / stated - 1) > _RATE_TOLERANCE:
        raise BagError(
            f'{path}: damaged: {LOAD_CELL_INFO.name} states {stated:g} Hz, the samples came at '
            f'{found:g} Hz; restore the file'
        )
    doubtful = doubtful_blocks(blocks, stated)
    text, count = f'{path}: {NO_CHECK_SUMS}', int(np.count_nonzero(doubtful))
    if count:
        text += f'; {count} blocks that do not fit those beside them are left out'
    return replace(recording, blocks=blocks.take(np.flatnonzero(~doubtful)), doubt=text)


def _check_numbers(path: Path, reader: Reader, read: Mapping[str, int], lane: Lane) -> None:
    """Check that all messages have been read that the bag says it holds.

    A folder says so twice, in ``metadata.yaml`` and in its files. Where the two disagree, or where
    a topic has another name in one of them, messages would be passed over silently.
    """
    storage = reader.storage
    stated = _stated_numbers(storage.connections)
    if isinstance(storage, DirectoryReader):
        stored = _stated_numbers(one for part in storage.storages for one in part.connections)
        for name in sorted(stated.keys() | stored.keys()):
            if stated[name] != stored[name]:
                raise BagError(
                    f'{path}: damaged: metadata.yaml says {stated[name]} messages on {name}, the '
                    f'files say {stored[name]}; restore it or run "ros2 bag reindex"'
                )
    for name in {connection.topic for connection, _ in lane}:
        if stated[name] != read[name]:
            raise BagError(
                f'{path}: damaged: {read[name]} of {stated[name]} messages on {name} can be read; '
                'restore it'
            )


def _stated_numbers(connections: Iterable[Connection]) -> Counter[str]:
    numbers: Counter[str] = Counter()
    for connection in connections:
        numbers[connection.topic] += connection.msgcount
    return numbers

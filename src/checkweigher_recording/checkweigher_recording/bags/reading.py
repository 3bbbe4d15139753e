# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading a ROS 2 bag into records: MCAP or SQLite, the whole bag or a clear error."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from checkweigher_dsp.records import NANOSECONDS, LoadCell
from checkweigher_dsp.ros.ports import (
    LOAD_CELL_INFO,
    LOAD_CELL_SAMPLES,
    PHOTO_EYES,
    PLAYED,
    REFERENCE_MASS,
    Port,
)
from checkweigher_recording.bags.bounds import MOST_EVENTS, MOST_SAMPLES, MOST_TOPICS, qos_unread
from checkweigher_recording.bags.definitions import BagError, check_definition, deserialize
from checkweigher_recording.bags.integrity import check_mcap
from checkweigher_recording.bags.lanes import Lane, choose_lane
from checkweigher_recording.bags.sample_decoding import SampleDecoder
from checkweigher_recording.bags.sqlite import (
    NO_CHECK_SUMS,
    check_sqlite,
    doubtful_blocks,
    doubtful_stamps,
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
from checkweigher_recording.recording import BlockColumns, Recording, canonical_order

_RATE_TOLERANCE = 0.1


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
    with bag_errors(path), qos_unread():
        if parts := unfinished_parts(path):
            return _read_unfinished(path, UnfinishedBag(parts), namespace, progress)
        information = _information(path)
        with unpacked(path, information) as folder:
            for file in files_of(folder, _information(folder)) if path.is_dir() else [path]:
                check = check_sqlite if file.suffix == '.db3' else check_mcap
                check(file)
            with Reader(folder) as reader:
                return _read_lane(path, reader, namespace, progress)


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


def _read_unfinished(
    path: Path, bag: UnfinishedBag, namespace: str | None, progress: bool
) -> Recording:
    """Read a recording that broke off, up to there."""
    if bag.damage:
        raise BagError(
            f'{path}: damaged: {bag.damage}; restore it, or "checkweigher recover" saves what is '
            'before it'
        )
    if not bag.message_count:
        raise BagError(f'{path}: the recording broke off before anything of it was written')
    recording = _read_lane(path, bag, namespace, progress)
    last = max(recording.blocks, key=lambda block: block.stamp)
    length = len(last.counts) / recording.load_cell.sample_rate
    length += (last.stamp - recording.blocks[0].stamp) / NANOSECONDS
    text = (
        f'{path}: the recording broke off, or is still going on; read up to {length:.1f} s '
        f'({bag.message_count} messages)'
    )
    return replace(recording, unfinished=text)


def _read_lane(
    path: Path, reader: Reader | UnfinishedBag, namespace: str | None, progress: bool
) -> Recording:
    if len(reader.connections) > MOST_TOPICS:
        raise BagError(f'{path}: has more than {MOST_TOPICS} topics; record those of the lane')
    lane = choose_lane(path, reader.connections, namespace)
    for connection, port in lane:
        check_definition(path, connection, port)
    messages = _Messages(path)
    stored = _stored(reader, [connection for connection, _ in lane])
    total = sum(connection.msgcount for connection, _ in lane)
    ports = {connection.topic: port for connection, port in lane}
    for connection, logged, data in with_progress(stored, 'reading', total, shown=progress):
        messages.take(connection.topic, ports[connection.topic], logged, data)
    if isinstance(reader, Reader):
        _check_numbers(path, reader, messages.numbers, lane)
    recording = messages.recording()
    if any(name.endswith('.db3') for name in _names(reader)):
        messages.check_stamps()
        return _without_doubtful(path, recording)
    return recording


def _stored(
    reader: Reader | UnfinishedBag, connections: Sequence[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield the messages of some connections, unpacked."""
    each = False
    if isinstance(reader, Reader) and isinstance(reader.storage, DirectoryReader):
        # rosbags would unpack a message of any size.
        each = reader.storage.metadata.compression_mode == 'message'
        reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)
    for connection, logged, data in reader.messages(connections):
        yield connection, logged, unpack_message(data) if each else data


class _Messages:
    """The messages of a lane as they are read: their records, and how many of each topic."""

    def __init__(self, path: Path) -> None:
        self.numbers: Counter[str] = Counter()
        self._logged: dict[str, list[int]] = {port.name: [] for port in PLAYED}  # ns
        self._path = path
        self._samples = SampleDecoder()
        self._records: dict[str, list[Any]] = {port.name: [] for port in PLAYED}

    def take(self, topic: str, port: Port, logged: int, data: bytes) -> None:
        """Add a message."""
        self.numbers[topic] += 1
        if port is LOAD_CELL_SAMPLES:
            self._samples.add(data)
        else:
            self._records[port.name].append(_record(self._path, port, data))
            self._logged[port.name].append(logged)
        if self._samples.size > MOST_SAMPLES or len(self._records[port.name]) > MOST_EVENTS:
            raise BagError(
                f'{self._path}: longer than fits into memory; record shorter bags, or split it by '
                '"ros2 bag convert"'
            )

    def check_stamps(self) -> None:
        """Raise BagError at an edge or a known mass that was logged at another time."""
        for port in (PHOTO_EYES, REFERENCE_MASS):
            stamps = [record.stamp for record in self._records[port.name]]
            for place in np.flatnonzero(doubtful_stamps(self._logged[port.name], stamps)):
                raise BagError(
                    f'{self._path}: damaged: message {place + 1} of {port.name} was logged at '
                    f'{self._logged[port.name][place]} ns, which its stamp of {stamps[place]} ns '
                    'does not fit; restore the file'
                )

    def recording(self) -> Recording:
        """Return what was read."""
        path, records, blocks = self._path, self._records, self._samples.blocks()
        cell = _load_cell(path, records[LOAD_CELL_INFO.name])
        if not blocks:
            raise BagError(
                f'{path}: no samples on {LOAD_CELL_SAMPLES.name}; the driver was not running'
            )
        return Recording(
            cell,
            blocks.in_canonical_order(),
            tuple(sorted(records[PHOTO_EYES.name], key=canonical_order)),
            tuple(sorted(records[REFERENCE_MASS.name], key=canonical_order)),
        )


def _names(reader: Reader | UnfinishedBag) -> list[str]:
    """Return the names of the files that a reader reads."""
    if isinstance(reader, UnfinishedBag):
        return []
    storage: Any = reader.storage
    parts: list[Any] = storage.storages if isinstance(storage, DirectoryReader) else [storage]
    return [part.path.name for part in parts]


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


def _record(path: Path, port: Port, data: bytes) -> Any:
    """Return the load cell, edge or known mass of a message."""
    try:
        return deserialize(port, data)
    except ValueError as error:
        if port is not LOAD_CELL_INFO:
            raise
        raise BagError(f'{path}: {port.name}: {error}; correct the driver, record again') from None


def _load_cell(path: Path, cells: Sequence[LoadCell]) -> LoadCell:
    if not cells:
        raise BagError(
            f'{path}: no {LOAD_CELL_INFO.name}, so its counts mean nothing; record that topic, too'
        )
    if any(cell != cells[0] for cell in cells):
        raise BagError(
            f'{path}: {LOAD_CELL_INFO.name} changes within the bag; record one bag for each '
            'calibration'
        )
    return cells[0]


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

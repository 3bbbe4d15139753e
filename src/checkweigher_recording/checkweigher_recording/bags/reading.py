# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading a ROS 2 bag into records: MCAP or SQLite, the whole bag or a clear error."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

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
from checkweigher_recording.bags.definitions import BagError, check_definition, deserialize
from checkweigher_recording.bags.integrity import check_mcap
from checkweigher_recording.bags.lanes import Lane, choose_lane
from checkweigher_recording.bags.sample_decoding import SampleDecoder
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts
from checkweigher_recording.progress import with_progress
from checkweigher_recording.recording import Recording, canonical_order


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
    with _errors_in_one_line(path):
        if parts := unfinished_parts(path):
            return _read_unfinished(path, UnfinishedBag(parts), namespace, progress)
        _check_files(path)
        with Reader(path) as reader:
            return _read_lane(path, reader, namespace, progress)


@contextmanager
def _errors_in_one_line(path: Path) -> Iterator[None]:
    """Turn any exception of a parser on strange bytes into one line."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror or error}') from error
    # Damaged bytes can lead a parser anywhere, so no list of its exceptions would be complete.
    except Exception as error:
        text = ' '.join(str(error).split()) or type(error).__name__
        raise BagError(f'{path}: damaged: {text}; record it again or restore it') from error


def _check_files(path: Path) -> None:
    """Check what can be seen without knowing the messages."""
    if not path.exists():
        raise BagError(f'{path}: there is no such file or folder')
    if not path.is_dir():
        if path.suffix not in ('.mcap', '.db3'):
            raise BagError(f'{path}: not a bag: neither a folder nor a .mcap or .db3 file')
        files = [path]
    elif not (path / 'metadata.yaml').exists():
        raise BagError(f'{path}: not a bag: it has neither metadata.yaml nor an .mcap file')
    else:
        files = sorted(path.iterdir())
    for file in files:
        if file.suffix == '.mcap':
            check_mcap(file)


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
    lane = choose_lane(path, reader.connections, namespace)
    for connection, port in lane:
        check_definition(path, connection, port)
    ports = {connection.topic: port for connection, port in lane}
    connections = [connection for connection, _ in lane]
    total = sum(connection.msgcount for connection in connections)
    messages = with_progress(reader.messages(connections), 'reading', total, shown=progress)
    numbers: Counter[str] = Counter()
    samples = SampleDecoder()
    records: dict[str, list[Any]] = {port.name: [] for port in PLAYED}
    for connection, _, data in messages:
        numbers[connection.topic] += 1
        port = ports[connection.topic]
        if port is LOAD_CELL_SAMPLES:
            samples.add(data)
        else:
            records[port.name].append(_record(path, port, data))
    blocks = samples.blocks()
    if isinstance(reader, Reader):
        _check_numbers(path, reader, numbers, lane)
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

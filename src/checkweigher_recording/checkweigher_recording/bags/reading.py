# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader for ROS 2 bags in MCAP or SQLite."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from checkweigher_core.recording import Recording
from checkweigher_core.ros.ports import LOAD_CELL_INFO
from checkweigher_recording.bags.definitions import BagError, bag_errors, check_definition
from checkweigher_recording.bags.integrity import check_file
from checkweigher_recording.bags.lane_messages import LaneMessages, OutOfOrderError
from checkweigher_recording.bags.lanes import Lane, choose_lane
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts
from checkweigher_recording.progress import with_progress

T = TypeVar('T')


def read_bag(path: Path, namespace: str | None = None, *, progress: bool = False) -> Recording:
    """Read one lane of a bag.

    Parameters
    ----------
    path : Path
        Folder of a bag, or a single ``.mcap`` or ``.db3`` file. A folder without ``metadata.yaml``
        is an incomplete recording, whose ``.mcap`` files are read as far as possible.
    namespace : str or None
        Namespace of the lane. It may be None if the bag has only one lane.
    progress : bool
        Whether to show a progress bar on a terminal.

    Returns
    -------
    Recording
        Events in canonical order, whatever their order in the bag. Its `warning` is not empty if
        the recording is incomplete, or is stored in SQLite, which has no check sums.

    Raises
    ------
    BagError
        If the bag is missing or damaged, contains no lane of a checkweigher, contains several
        lanes while `namespace` is None, or was recorded with other message definitions. Also if the
        lane has no samples, no load-cell message, or load-cell messages that differ.

    Notes
    -----
    Check sums are verified if the file contains them. For each topic, the number of messages in
    ``metadata.yaml`` must equal the number that the files state. For each topic of the lane, the
    number of messages that were read must equal these two. An incomplete recording states no
    numbers, so they are not compared.
    """
    (recording,) = read_stretches(path, namespace, progress=progress, whole=True)
    return recording


def read_stretches(
    path: Path, namespace: str | None = None, *, progress: bool = False, whole: bool = False
) -> Iterator[Recording]:
    """Read one lane of a bag in consecutive parts ("stretches"), so that little memory is needed.

    If `whole` is True, the bag is a single part. Together, the parts contain the events that
    `read_bag` returns, in the same order. The first part contains samples, and the last part
    contains the `warning`. The number of messages is checked only after all parts but the last have
    been yielded. If messages were lost, the last part is not yielded; `BagError` is raised instead,
    and messages may be missing in any of the earlier parts. The other parameters and exceptions are
    as in `read_bag`.

    Raises `OutOfOrderError` if a message belongs to a part that was already returned. This error
    occurs only if the time stamp of the message is more than one minute before the time stamp of an
    earlier message. In contrast, `read_bag` accepts messages in any order.
    """
    with open_bag(path) as bag:
        lane = choose_lane(path, bag.connections, namespace)
        for connection, port in lane:
            check_definition(path, connection, port)
        messages = LaneMessages(path)
        if cell := _load_cell(bag, lane):
            messages.take_cell(cell)
        ports = {connection.topic: port for connection, port in lane}
        connections = [connection for connection, _ in lane]
        found = bag.messages(connections)
        count = sum(connection.msgcount for connection in connections)
        for connection, _, data in with_progress(found, 'reading', count, shown=progress):
            messages.take(connection.topic, ports[connection.topic], data)
            if not whole and (stretch := messages.stretch()) is not None:
                yield stretch
        if isinstance(bag, Reader):
            _check_numbers(path, bag, ports, messages.numbers)
        yield replace(messages.rest(), warning=_warning(path, bag))


def over_stretches(
    work: Callable[[Iterable[Recording]], T],
    path: Path,
    namespace: str | None = None,
    *,
    progress: bool = False,
) -> T:
    """Return the result of `work` for the parts of a bag that `read_stretches` yields.

    If the messages are too far out of order for `read_stretches`, `work` is called again with the
    whole bag as a single part. The other parameters and exceptions are as in `read_bag`. Exceptions
    of `work` are raised unchanged.
    """
    try:
        return work(read_stretches(path, namespace, progress=progress))
    except OutOfOrderError:
        return work([read_bag(path, namespace, progress=progress)])


def _load_cell(bag: Reader | UnfinishedBag, lane: Lane) -> bytes | None:
    """Return the first message that describes the load cell of a lane, or None if there is none."""
    cells = [connection for connection, port in lane if port is LOAD_CELL_INFO]
    # Do not call `messages` with an empty list, for which rosbags would return all messages.
    return next((data for _, _, data in bag.messages(cells)), None) if cells else None


@contextmanager
def open_bag(path: Path) -> Iterator[Reader | UnfinishedBag]:
    """Check the files of a bag, and open the bag or the readable part of an incomplete recording.

    Yields the open bag, and closes it when the context ends. Exceptions that are raised within the
    context are converted to `BagError`.
    """
    with bag_errors(path):
        if parts := unfinished_parts(path):
            yield _unfinished(path, parts)
            return
        for file in _files(path):
            check_file(file)
        with Reader(path) as reader:
            if reader.compression_mode == 'file':
                for part in _parts(reader):
                    check_file(part.path, path / part.path.name)
            yield reader


def _unfinished(path: Path, parts: Sequence[Path]) -> UnfinishedBag:
    bag = UnfinishedBag(parts)
    if bag.damage:
        raise BagError(
            f'{path}: damaged: {bag.damage}; restore the bag, or save the messages before the '
            'damage by "checkweigher recover"'
        )
    if not bag.message_count:
        raise BagError(
            f'{path}: contains no readable message; the recording broke off, or has just begun'
        )
    return bag


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise BagError(f'{path}: there is no such file or folder')
    if path.is_file() and path.suffix in ('.mcap', '.db3'):
        return [path]
    if not path.is_dir():
        raise BagError(f'{path}: not a bag: neither a folder nor a .mcap or .db3 file')
    if not (path / 'metadata.yaml').exists():
        raise BagError(f'{path}: not a bag: it has neither metadata.yaml nor an .mcap file')
    return sorted([*path.glob('*.mcap'), *path.glob('*.db3')])


def _parts(reader: Reader) -> list[Any]:
    return getattr(reader.storage, 'storages', [reader.storage])


def _warning(path: Path, bag: Reader | UnfinishedBag) -> str:
    """Return a warning that the bag is incomplete or in SQLite, or an empty string otherwise."""
    if isinstance(bag, UnfinishedBag):
        return (
            f'{path}: the recording broke off, or is still going on; read up to '
            f'{bag.duration:.1f} s ({bag.message_count} messages)'
        )
    if any(part.path.suffix == '.db3' for part in _parts(bag)):
        return (
            f'{path}: an SQLite bag has no check sums, so damage may falsify a mass; record '
            'MCAP (ros2 bag record -s mcap)'
        )
    return ''


def _check_numbers(
    path: Path, reader: Reader, topics: Iterable[str], read: Mapping[str, int]
) -> None:
    """Check that no messages were lost.

    The number of messages of each topic must be the same in ``metadata.yaml`` and in the files.
    `read` contains the numbers of messages that were read. For each topic in `topics`, the number
    in `read` must equal the number in the files.

    Raises `BagError` if two of the numbers differ.
    """
    stated = _numbers(reader.connections)
    stored = _numbers(one for part in _parts(reader) for one in part.connections)
    for name in sorted(stated.keys() | stored.keys()):
        if stated[name] != stored[name]:
            raise BagError(
                f'{path}: damaged: metadata.yaml says {stated[name]} messages on {name}, but the '
                f'files say {stored[name]}; restore it or run "ros2 bag reindex"'
            )
    for name in topics:
        if read[name] != stored[name]:
            raise BagError(
                f'{path}: damaged: {read[name]} of {stored[name]} messages on {name} can be read; '
                'restore it'
            )


def _numbers(connections: Iterable[Connection]) -> Counter[str]:
    numbers: Counter[str] = Counter()
    for connection in connections:
        numbers[connection.topic] += connection.msgcount
    return numbers

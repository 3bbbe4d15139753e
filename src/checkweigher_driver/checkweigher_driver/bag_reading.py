"""Reading a ROS 2 bag into records: MCAP or SQLite, the whole bag or a clear error."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from checkweigher_driver.bag_messages import (
    INPUT_TOPICS,
    LOAD_CELL_INFO,
    PHOTO_EYES,
    REFERENCE_MASS,
    SAMPLES,
    BagError,
    Topic,
    lane_prefix,
    typestore,
)
from checkweigher_driver.bag_types import check_type
from checkweigher_driver.bag_unfinished import UnfinishedBag, unfinished_parts
from checkweigher_driver.mcap_integrity import check_mcap
from checkweigher_driver.progress import with_progress
from checkweigher_driver.recording import Event, Recording
from checkweigher_driver.sample_decoding import sample_block_from
from checkweigher_dsp.records import (
    NANOSECONDS,
    Eye,
    EyeEdge,
    LoadCell,
    Reference,
    SampleBlock,
)


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
        Whether to show a bar on a terminal if it takes more than two seconds.

    Returns
    -------
    Recording
        The events in canonical order, whatever their order in the bag; `unfinished` if the
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
    with _one_line(path):
        if parts := unfinished_parts(path):
            return _read_unfinished(path, UnfinishedBag(parts), namespace, progress)
        _check_files(path)
        with Reader(path) as reader:
            return _read_lane(path, reader, namespace, progress)


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Turn whatever a parser raises on strange bytes into one line."""
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


_Lane = list[tuple[Connection, Topic]]


def _choose_lane(path: Path, connections: Sequence[Connection], namespace: str | None) -> _Lane:
    """Return the connections of one lane, each with the topic that it has the name of."""
    lanes: dict[str, _Lane] = {}
    for connection in connections:
        for topic in INPUT_TOPICS:
            prefix, found, rest = f'/{connection.topic.lstrip("/")}'.rpartition(f'/{topic.name}')
            if found and not rest:
                lanes.setdefault(prefix, []).append((connection, topic))
    if not lanes:
        names = ', '.join(sorted({connection.topic for connection in connections})) or 'none'
        raise BagError(
            f'{path}: not of a checkweigher: no topic {SAMPLES.name}; its topics are: {names}'
        )
    if namespace is None and len(lanes) == 1:
        return next(iter(lanes.values()))
    listed = ', '.join(prefix or '/' for prefix in sorted(lanes))
    if namespace is None:
        raise BagError(f'{path}: holds several lanes: {listed}; choose one by its namespace')
    prefix = lane_prefix(namespace)
    if prefix not in lanes:
        raise BagError(f'{path}: has no lane {prefix or "/"}; it has {listed}')
    return lanes[prefix]


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
    lane = _choose_lane(path, reader.connections, namespace)
    for connection, topic in lane:
        check_type(path, connection, topic)
    # Looked up by name, message for message: the hash of a Topic is that of all its fields.
    makers = {connection.topic: _EVENTS.get(topic) for connection, topic in lane}
    read = dict.fromkeys(makers, 0)
    cells: list[LoadCell] = []
    events: list[Event] = []
    deserialize = typestore().deserialize_cdr
    connections = [connection for connection, _ in lane]
    total = sum(connection.msgcount for connection in connections)
    messages = with_progress(reader.messages(connections), 'reading', total, shown=progress)
    for connection, _, data in messages:
        name = connection.topic
        read[name] += 1
        make = makers[name]
        if make is _block and (block := sample_block_from(data)):
            events.append(block)
            continue
        message: Any = deserialize(data, connection.msgtype)
        if make is None:
            cells.append(_load_cell(path, message))
        else:
            events.append(make(message))
    if isinstance(reader, Reader):
        _check_numbers(path, reader, read, lane)
    if not cells:
        raise BagError(
            f'{path}: no {LOAD_CELL_INFO.name}, so its counts mean nothing; record that topic, too'
        )
    if any(cell != cells[0] for cell in cells):
        raise BagError(
            f'{path}: {LOAD_CELL_INFO.name} changes within the bag; record one bag for each '
            'calibration'
        )
    recording = Recording.from_events(cells[0], events)
    if not recording.blocks:
        raise BagError(f'{path}: no samples on {SAMPLES.name}; the driver was not running')
    return recording


def _check_numbers(path: Path, reader: Reader, read: Mapping[str, int], lane: _Lane) -> None:
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


def _load_cell(path: Path, message: Any) -> LoadCell:
    try:
        return LoadCell(
            sample_rate=message.sample_rate,
            counts_per_kg=message.counts_per_kg,
            zero_counts=message.zero_counts,
            min_counts=message.min_counts,
            max_counts=message.max_counts,
            capacity=message.capacity,
            weigh_length=message.weigh_length,
            model=message.model,
            serial_number=message.serial_number,
        )
    except ValueError as error:
        raise BagError(f'{path}: {LOAD_CELL_INFO.name}: {error}') from None


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    sec: int = stamp.sec
    nanosec: int = stamp.nanosec
    if sec < 0 or nanosec >= NANOSECONDS:
        raise ValueError(f'a stamp of {sec} s and {nanosec} ns')
    return sec * NANOSECONDS + nanosec


def _block(message: Any) -> SampleBlock:
    return SampleBlock(_stamp(message), message.first_index, message.counts)


def _edge(message: Any) -> EyeEdge:
    return EyeEdge(_stamp(message), Eye(message.eye), bool(message.blocked))


def _reference(message: Any) -> Reference:
    if not (math.isfinite(message.mass) and message.mass >= 0):
        raise ValueError(f'a {REFERENCE_MASS.name} of {message.mass:g} kg')
    return Reference(_stamp(message), float(message.mass))


_EVENTS: dict[Topic, Callable[[Any], Event]] = {
    SAMPLES: _block,
    PHOTO_EYES: _edge,
    REFERENCE_MASS: _reference,
}

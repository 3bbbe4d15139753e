"""Reading a ROS 2 bag into records: MCAP or SQLite, the whole bag or a clear error."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import math
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

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
        Folder with ``metadata.yaml``, or a single ``.mcap`` or ``.db3`` file.
    namespace : str or None
        Of the lane; None if the bag has only one.
    progress : bool
        Whether to show a bar on a terminal if it takes more than two seconds.

    Returns
    -------
    Recording
        The events in canonical order, whatever their order in the bag.

    Raises
    ------
    BagError
        If the bag is missing, damaged, incomplete or foreign. It is never read in part.

    Notes
    -----
    Check sums are checked where the file has them; some writers leave them out. The numbers of
    messages must agree wherever the bag states them.
    """
    with _one_line(path):
        _check_files(path)
        with Reader(path) as reader:
            lane = _choose_lane(path, reader.connections, namespace)
            for connection, topic in lane:
                _check_type(path, connection, topic)
            return _read_lane(path, reader, lane, progress)


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
        raise BagError(
            f'{path}: not a bag: it has no metadata.yaml; a recording that broke off may be '
            'read by naming its .mcap file'
        )
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


def _check_type(path: Path, connection: Connection, topic: Topic) -> None:
    """Check that the messages of a connection are those that are installed here."""
    if connection.msgtype != topic.message_type:
        raise BagError(
            f'{path}: topic {connection.topic} holds {connection.msgtype}, must hold '
            f'{topic.message_type}'
        )
    here = typestore().hash_rihs01(topic.message_type)
    for there in (connection.digest, _type_hash(connection.msgdef, topic)):
        if there and there != here:
            raise BagError(
                f'{path}: topic {connection.topic} was recorded with another definition of '
                f'{topic.message_type} ({there}, here {here}); use the version that recorded it'
            )


def _type_hash(definition: MessageDefinition, topic: Topic) -> str:
    """Return the hash of a definition that a bag brings along, empty if it brings none."""
    if definition.data == typestore().generate_msgdef(topic.message_type, ros_version=2)[0]:
        return typestore().hash_rihs01(topic.message_type)
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, topic.message_type))
    elif definition.format == MessageDefinitionFormat.IDL:
        store.register(get_types_from_idl(definition.data))
    else:
        return ''
    return store.hash_rihs01(topic.message_type)


def _read_lane(path: Path, reader: Reader, lane: _Lane, progress: bool) -> Recording:
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

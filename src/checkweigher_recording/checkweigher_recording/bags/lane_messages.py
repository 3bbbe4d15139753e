"""The messages of one lane of a bag, decoded: all of them, or those of a part of its chunks."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection

from checkweigher_dsp.records import NANOSECONDS, Eye, EyeEdge, LoadCell, Reference, SampleBlock
from checkweigher_recording.bags.block_columns import BlockColumns
from checkweigher_recording.bags.message_decoding import SampleDecoder, eye_edge_from
from checkweigher_recording.bags.messages import (
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

Lane = list[tuple[Connection, Topic]]


@dataclass(frozen=True, slots=True)
class LaneMessages:
    """What the messages of a lane say, in the order in which they were read.

    Attributes
    ----------
    numbers : mapping of str to int
        Messages of each topic.
    cells : tuple of LoadCell
        One for each message of it.
    blocks : BlockColumns
        The samples.
    edges : tuple of EyeEdge
        The edges.
    references : tuple of Reference
        The known masses.
    log_times : ndarray, (n,) int64
        ns, of the messages of `blocks`.
    """

    numbers: Mapping[str, int]
    cells: tuple[LoadCell, ...]
    blocks: BlockColumns
    edges: tuple[EyeEdge, ...]
    references: tuple[Reference, ...]
    log_times: NDArray[np.int64]

    @classmethod
    def concatenate(cls, parts: Sequence['LaneMessages']) -> 'LaneMessages':
        """Return the messages of all parts, one part after the other."""
        numbers = {name: sum(part.numbers[name] for part in parts) for name in parts[0].numbers}
        return cls(
            numbers,
            tuple(cell for part in parts for cell in part.cells),
            BlockColumns.concatenate([part.blocks for part in parts]),
            tuple(edge for part in parts for edge in part.edges),
            tuple(reference for part in parts for reference in part.references),
            np.concatenate([part.log_times for part in parts]),
        )

    def by_log_time(self) -> 'LaneMessages':
        """Return the same with the blocks in the order of their log times, equal ones as here."""
        order = np.argsort(self.log_times, kind='stable')
        return replace(self, blocks=self.blocks.taken(order), log_times=self.log_times[order])


def choose_lane(path: Path, connections: Sequence[Connection], namespace: str | None) -> Lane:
    """Return the connections of one lane, each with the topic that it has the name of.

    Raises
    ------
    BagError
        If there is no such lane, or several and no namespace.
    """
    lanes: dict[str, Lane] = {}
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


def decode(
    path: Path, lane: Lane, messages: Iterable[tuple[Connection, int, bytes]]
) -> LaneMessages:
    """Decode messages of a lane.

    Parameters
    ----------
    path : Path
        Of the bag, for errors.
    lane : list of (Connection, Topic)
        What the connections of the messages are.
    messages : iterable of (Connection, int, bytes)
        Connection, log time in ns, and the message.

    Raises
    ------
    BagError
        If the message of a load cell describes none.
    Exception
        Whatever `messages` raises, and a parser on strange bytes.
    """
    decoder = LaneDecoder(path, lane)
    try:
        for connection, log_time, data in messages:
            decoder.add(connection.topic, (log_time,), (data,))
    except Exception:
        decoder.flush()  # what is wrong with a message before this one comes first
        raise
    return decoder.found()


class LaneDecoder:
    """Decode messages of a lane, any number of one topic at a time.

    Parameters
    ----------
    path : Path
        Of the bag, for errors.
    lane : list of (Connection, Topic)
        What the connections of the messages are.
    """

    def __init__(self, path: Path, lane: Lane) -> None:
        self._path = path
        # Looked up by name: the hash of a Topic is that of all its fields.
        topics = {connection.topic: topic for connection, topic in lane}
        self._samples = {name for name, topic in topics.items() if topic == SAMPLES}
        self._found: dict[Topic, list[Any]] = {topic: [] for topic in _MAKERS}
        self._makers = {
            name: (_MAKERS[topic], self._found[topic])
            for name, topic in topics.items()
            if topic in _MAKERS
        }
        self._numbers = dict.fromkeys(topics, 0)
        self._blocks = SampleDecoder(lambda data: _block(_deserialized(SAMPLES, data)))
        self._log_times: list[int] = []

    def add(self, name: str, log_times: Sequence[int], messages: Sequence[bytes]) -> None:
        """Take messages of the topic of that name, and their log times in ns.

        Raises
        ------
        BagError
            If the message of a load cell describes none.
        Exception
            Whatever a parser raises on strange bytes.
        """
        self._numbers[name] += len(messages)
        if name in self._samples:
            self._log_times += log_times
            self._blocks.add(messages)
        else:
            make, found = self._makers[name]
            found += [make(self._path, data) for data in messages]

    def flush(self) -> None:
        """Decode what has been collected."""
        self._blocks.flush()

    def found(self) -> LaneMessages:
        """Return what all messages say."""
        cells, edges, references = (
            tuple(self._found[topic]) for topic in (LOAD_CELL_INFO, PHOTO_EYES, REFERENCE_MASS)
        )
        log_times = np.array(self._log_times, np.int64)
        return LaneMessages(
            self._numbers, cells, self._blocks.blocks(), edges, references, log_times
        )


def _deserialized(topic: Topic, data: bytes) -> Any:
    return typestore(INPUT_TOPICS).deserialize_cdr(data, topic.message_type)


def _load_cell(path: Path, data: bytes) -> LoadCell:
    message = _deserialized(LOAD_CELL_INFO, data)
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


def _edge(_: Path, data: bytes) -> EyeEdge:
    edge = eye_edge_from(data)
    if edge is not None:
        return edge
    message = _deserialized(PHOTO_EYES, data)
    return EyeEdge(_stamp(message), Eye(message.eye), bool(message.blocked))


def _reference(_: Path, data: bytes) -> Reference:
    message = _deserialized(REFERENCE_MASS, data)
    if not (math.isfinite(message.mass) and message.mass >= 0):
        raise ValueError(f'a {REFERENCE_MASS.name} of {message.mass:g} kg')
    return Reference(_stamp(message), float(message.mass))


_MAKERS: dict[Topic, Callable[[Path, bytes], Any]] = {
    LOAD_CELL_INFO: _load_cell,
    PHOTO_EYES: _edge,
    REFERENCE_MASS: _reference,
}

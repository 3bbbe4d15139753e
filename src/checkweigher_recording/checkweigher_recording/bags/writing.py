"""Writing the events of a lane as a ROS 2 bag: the same bytes for the same events."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from checkweigher_dsp.records import NANOSECONDS, EyeEdge, LoadCell, SampleBlock
from checkweigher_recording.bags.file import BagFile
from checkweigher_recording.bags.messages import (
    HEADER,
    INPUT_TOPICS,
    LOAD_CELL_INFO,
    PHOTO_EYES,
    REFERENCE_MASS,
    SAMPLES,
    TIME,
    Topic,
    typestore,
)
from checkweigher_recording.recording import Event


class BagWriter(BagFile):
    """A new bag of the events of one lane; the log time of a message is the stamp of its event.

    Parameters
    ----------
    path : Path
        Folder to make; its parent must exist.
    load_cell : LoadCell
        The cell that took the samples.
    namespace : str
        Of the lane, ``''`` for none.
    """

    def __init__(self, path: Path, load_cell: LoadCell, namespace: str = '') -> None:
        super().__init__(path, INPUT_TOPICS, namespace)
        self._encoder = _Encoder(load_cell)

    def write(self, event: Event) -> None:
        """Append an event; the stamp of the first one is also that of the load cell's message."""
        if self.message_count == 0:
            self.put(LOAD_CELL_INFO, event.stamp, self._encoder.describe(event.stamp))
        self.put(*self._encoder.encode(event))


def write_bag(
    path: Path, load_cell: LoadCell, events: Iterable[Event], namespace: str = ''
) -> None:
    """Write the events of one lane as a new bag, all or nothing.

    Parameters
    ----------
    path : Path
        Folder to make; its parent must exist.
    load_cell : LoadCell
        The cell that took the samples.
    events : iterable of SampleBlock, EyeEdge or Reference
        In canonical order; they are not kept.
    namespace : str
        Of the lane, ``''`` for none.

    Raises
    ------
    OutputError
        If there is something at `path` already, or it cannot be written.
    BagError
        If the message definitions are not installed.
    """
    with BagWriter(path, load_cell, namespace) as bag:
        for event in events:
            bag.write(event)


class _Encoder:
    """Makes messages of records."""

    def __init__(self, load_cell: LoadCell) -> None:
        self._load_cell = load_cell
        self._store = typestore()
        self._time, self._header = self._store.types[TIME], self._store.types[HEADER]

    def describe(self, stamp: int) -> bytes:
        """Return the load cell's message."""
        cell = self._load_cell
        return self._serialize(
            LOAD_CELL_INFO,
            stamp,
            model=cell.model,
            serial_number=cell.serial_number,
            sample_rate=cell.sample_rate,
            counts_per_kg=cell.counts_per_kg,
            zero_counts=cell.zero_counts,
            min_counts=cell.min_counts,
            max_counts=cell.max_counts,
            capacity=cell.capacity,
            weigh_length=cell.weigh_length,
        )

    def encode(self, event: Event) -> tuple[Topic, int, bytes]:
        """Return an event's topic, log time and message."""
        topic, content = _content(event)
        return topic, event.stamp, self._serialize(topic, event.stamp, **content)

    def _serialize(self, topic: Topic, stamp: int, **content: Any) -> bytes:
        second, nanosecond = divmod(stamp, NANOSECONDS)
        header = self._header(self._time(second, nanosecond), '')
        message = self._store.types[topic.message_type](header=header, **content)
        return bytes(self._store.serialize_cdr(message, topic.message_type, little_endian=True))


def _content(event: Event) -> tuple[Topic, dict[str, Any]]:
    if isinstance(event, SampleBlock):
        counts = np.ascontiguousarray(event.counts, '<i4')
        return SAMPLES, {'first_index': event.first_index, 'counts': counts}
    if isinstance(event, EyeEdge):
        return PHOTO_EYES, {'eye': int(event.eye), 'blocked': event.blocked}
    return REFERENCE_MASS, {'mass': event.mass}

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of the messages of a lane to consecutive parts ("stretches") of a recording."""

from bisect import bisect_left
from collections import Counter
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path

import numpy as np

from checkweigher_core.recording import BlockColumns, Recording, canonical_order
from checkweigher_core.records import NANOSECONDS, EyeEdge, LoadCell, Reference
from checkweigher_core.ros.ports import LOAD_CELL_INFO, LOAD_CELL_SAMPLES, Port
from checkweigher_recording.bags.definitions import BagError, deserialize
from checkweigher_recording.bags.sample_decoding import decode_samples

# Number of messages, or total size of messages in bytes, after which the samples are decoded.
_AT_ONCE, _BYTES_AT_ONCE = 4096, 1 << 22
# Maximum time in ns by which the stamp of a message may precede the stamp of an earlier message.
_LATE = 60 * NANOSECONDS


class OutOfOrderError(BagError):
    """Raised if a message belongs to a stretch that was already returned."""


class LaneMessages:
    """Buffer for the messages of a lane that are not part of a returned stretch yet.

    `path` is the path of the bag, which is used in error messages. `numbers` counts the messages of
    each topic.
    """

    def __init__(self, path: Path) -> None:
        self.numbers: Counter[str] = Counter()
        self._path = path
        self._cell: LoadCell | None = None
        self._samples: list[bytes] = []  # messages with samples that are not decoded yet
        self._blocks = [BlockColumns.of([])]
        self._events: list[EyeEdge | Reference] = []
        # Number and total size in bytes of the messages since the last decoding.
        self._since = self._bytes = 0
        self._end: int | None = None  # end of the last stretch in ns

    def take(self, topic: str, port: Port, data: bytes) -> None:
        """Add a message.

        If the message is not valid, the exceptions of `deserialize` or, for a load-cell message, of
        `take_cell` are raised. Messages with samples are decoded many at a time, so for such a
        message, a later call of `take` or `rest` may raise the exception.
        """
        self.numbers[topic] += 1
        self._since += 1
        self._bytes += len(data)
        if port is LOAD_CELL_SAMPLES:
            self._samples.append(data)
        elif port is LOAD_CELL_INFO:
            self.take_cell(data)
        else:
            self._events.append(deserialize(port, data))
        if self._since == _AT_ONCE or self._bytes >= _BYTES_AT_ONCE:
            self._decode()

    def _decode(self) -> None:
        self._blocks.append(decode_samples(self._samples))
        self._samples, self._since, self._bytes = [], 0, 0

    def take_cell(self, data: bytes) -> None:
        """Add a load-cell message. A bag may contain several load-cell messages if they are equal.

        Raises `BagError` if the message is not valid, or differs from an earlier one.
        """
        try:
            cell: LoadCell = deserialize(LOAD_CELL_INFO, data)
        except ValueError as error:
            raise BagError(
                f'{self._path}: {LOAD_CELL_INFO.name}: {error}; correct the driver and record again'
            ) from None
        if self._cell not in (None, cell):
            raise BagError(
                f'{self._path}: {LOAD_CELL_INFO.name} changes within the bag; record one bag for '
                'each calibration'
            )
        self._cell = cell

    def stretch(self) -> Recording | None:
        """Return the next stretch, which ends one minute before the latest stamp.

        Returns None if messages were added after the latest decoding, if the stretch would contain
        no samples, or if its end would not be later than the end of the previous stretch. Raises
        `OutOfOrderError` if a message belongs to a stretch that was already returned, and
        `BagError` if no load-cell message has been added.
        """
        if self._since:  # some messages are not decoded yet
            return None
        blocks = self._sorted()
        latest = [int(stamp) for stamp in blocks.stamps[-1:]]
        end = max([*latest, *(event.stamp for event in self._events[-1:])], default=0) - _LATE
        place = int(np.searchsorted(blocks.stamps, end))
        if not place or (self._end is not None and end <= self._end):
            return None
        self._end = end
        complete, later = blocks.split(place)
        self._blocks = [later]
        number = bisect_left(self._events, end, key=attrgetter('stamp'))
        events, self._events = self._events[:number], self._events[number:]
        return self._recording(complete, events)

    def rest(self) -> Recording:
        """Return all remaining events as the last stretch.

        Raises `BagError` if the bag has no load-cell message or no samples, `OutOfOrderError` as
        `stretch` does, and the exceptions of `deserialize` if a message with samples is not valid.
        """
        self._decode()
        blocks = self._sorted()
        recording = self._recording(blocks, self._events)
        if not len(blocks) and self._end is None:
            raise BagError(
                f'{self._path}: no samples on {LOAD_CELL_SAMPLES.name}; the driver was not running'
            )
        return recording

    def _recording(self, blocks: BlockColumns, events: Sequence[EyeEdge | Reference]) -> Recording:
        if self._cell is None:
            raise BagError(
                f'{self._path}: no {LOAD_CELL_INFO.name}, so the counts have no unit; record that '
                'topic, too'
            )
        edges = tuple(event for event in events if isinstance(event, EyeEdge))
        references = tuple(event for event in events if isinstance(event, Reference))
        return Recording(self._cell, blocks, edges, references)

    def _sorted(self) -> BlockColumns:
        """Sort the events and the blocks, and return the blocks.

        Raises `OutOfOrderError` if an event or a block belongs to a stretch that was already
        returned.
        """
        blocks = BlockColumns.concatenate(self._blocks).in_canonical_order()
        self._blocks = [blocks]
        self._events.sort(key=canonical_order)
        first = [int(stamp) for stamp in blocks.stamps[:1]]
        first += [event.stamp for event in self._events[:1]]
        if self._end is not None and first and min(first) < self._end:
            raise OutOfOrderError(
                f'{self._path}: contains messages that are more than {_LATE // NANOSECONDS} s late'
            )
        return blocks

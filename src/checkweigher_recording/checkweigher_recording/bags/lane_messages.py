# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The messages of a lane as they are read, in any order, and the stretches that they make."""

from collections import Counter
from pathlib import Path
from typing import TypeVar

import numpy as np

from checkweigher_core.recording import BlockColumns, Recording, canonical_order
from checkweigher_core.records import NANOSECONDS, EyeEdge, LoadCell, Reference
from checkweigher_core.ros.ports import (
    LOAD_CELL_INFO,
    LOAD_CELL_SAMPLES,
    PHOTO_EYES,
    Port,
)
from checkweigher_recording.bags.definitions import BagError, deserialize
from checkweigher_recording.bags.sample_decoding import SampleDecoder

_AT_ONCE, _BYTES_AT_ONCE = 4096, 1 << 22  # messages between two stretches, and their bytes
_LATE = 60 * NANOSECONDS  # that a message may come after one with a later stamp
_Stamped = TypeVar('_Stamped', EyeEdge, Reference)


class OutOfOrderError(BagError):
    """A message that is so late that the stretch it belongs to has been read."""


class LaneMessages:
    """The messages of a lane of a bag as they are read.

    `path` is that of the bag, for errors; `numbers` counts the messages by topic. Of the messages
    those are kept that no stretch has.
    """

    def __init__(self, path: Path) -> None:
        self.numbers: Counter[str] = Counter()
        self._path = path
        self._cell: LoadCell | None = None
        self._samples = SampleDecoder()
        self._blocks = BlockColumns.of([])
        self._edges: list[EyeEdge] = []
        self._references: list[Reference] = []
        self._since = self._bytes = 0  # messages since the last stretch, and their bytes
        self._end: int | None = None  # of the last stretch, ns

    def take(self, topic: str, port: Port, data: bytes) -> None:
        """Add a message; BagError if it cannot be used."""
        self.numbers[topic] += 1
        self._since += 1
        self._bytes += len(data)
        if port is LOAD_CELL_SAMPLES:
            self._samples.add(data)
        elif port is LOAD_CELL_INFO:
            self.take_cell(data)
        else:
            kept = self._edges if port is PHOTO_EYES else self._references
            kept.append(deserialize(port, data))

    def take_cell(self, data: bytes) -> None:
        """Add the message of the load cell, or one that repeats it."""
        try:
            cell: LoadCell = deserialize(LOAD_CELL_INFO, data)
        except ValueError as error:
            raise BagError(
                f'{self._path}: {LOAD_CELL_INFO.name}: {error}; correct the driver, record again'
            ) from None
        if self._cell not in (None, cell):
            raise BagError(
                f'{self._path}: {LOAD_CELL_INFO.name} changes within the bag; record one bag for '
                'each calibration'
            )
        self._cell = cell

    def stretch(self) -> Recording | None:
        """Return what is complete up to a minute before the latest stamp, None if it is too soon.

        Raises
        ------
        OutOfOrderError
            If a message belongs before the end of a stretch that was returned.
        """
        if self._since < _AT_ONCE and self._bytes < _BYTES_AT_ONCE:
            return None
        self._since = self._bytes = 0
        self._sort()
        stamps = self._blocks.stamps
        end = max((int(stamps[-1]) if len(stamps) else 0), self._latest_event()) - _LATE
        place = int(np.searchsorted(stamps, end))
        if not place or (self._end is not None and end <= self._end):
            return None
        self._end = end
        complete, self._blocks = self._blocks.split(place)
        edges, self._edges = _cut(self._edges, end)
        references, self._references = _cut(self._references, end)
        return Recording(self.load_cell, complete, edges, references)

    def rest(self) -> Recording:
        """Return what no stretch has: everything, if there was none; raise as `stretch` does."""
        self._sort()
        cell = self.load_cell
        if not len(self._blocks) and self._end is None:
            raise BagError(
                f'{self._path}: no samples on {LOAD_CELL_SAMPLES.name}; the driver was not running'
            )
        return Recording(cell, self._blocks, tuple(self._edges), tuple(self._references))

    @property
    def load_cell(self) -> LoadCell:
        """The load cell; BagError if no message of it has come."""
        if self._cell is None:
            raise BagError(
                f'{self._path}: no {LOAD_CELL_INFO.name}, so its counts mean nothing; record that '
                'topic, too'
            )
        return self._cell

    def _sort(self) -> None:
        """Bring what is kept into canonical order; OutOfOrderError if some of it is too late."""
        parts = [self._blocks, self._samples.blocks()]
        self._blocks = BlockColumns.concatenate(parts).in_canonical_order()
        self._edges.sort(key=canonical_order)
        self._references.sort(key=canonical_order)
        first = [one[0].stamp for one in (self._edges, self._references) if one]
        first += self._blocks.stamps[:1].tolist()
        if self._end is not None and first and min(first) < self._end:
            raise OutOfOrderError(
                f'{self._path}: has messages that came more than {_LATE // NANOSECONDS} s late'
            )

    def _latest_event(self) -> int:
        return max((one[-1].stamp for one in (self._edges, self._references) if one), default=0)


def _cut(records: list[_Stamped], end: int) -> tuple[tuple[_Stamped, ...], list[_Stamped]]:
    """Return the records, in canonical order, before a time in ns, and the others."""
    place = sum(record.stamp < end for record in records)
    return tuple(records[:place]), records[place:]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Raw samples and edges of a lane or a recorded shift."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import BlockColumns
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock


@dataclass(frozen=True, slots=True)
class Stretch:
    """Segment of the raw signal: `time` (n,) in ns, `counts` (n,), and the eye edges within it."""

    time: NDArray[np.int64]
    counts: NDArray[np.int32]
    edges: tuple[EyeEdge, ...] = ()


@dataclass(frozen=True, slots=True)
class RawSignal:
    """Samples of a load cell in order of time, and photo-eye edges in order of arrival."""

    load_cell: LoadCell
    blocks: Sequence[SampleBlock]
    edges: Sequence[EyeEdge]

    def between(self, begin: int, end: int) -> tuple[SampleBlock, ...]:
        """Return the blocks that contain the samples from `begin` to `end` in ns.

        The first and the last of these blocks may also contain samples outside this time.
        """
        stamps = BlockColumns.of(self.blocks).stamps
        first = max(int(np.searchsorted(stamps, begin, 'right')) - 1, 0)
        return tuple(self.blocks[first : int(np.searchsorted(stamps, end, 'right'))])

    def stretch(self, begin: int, end: int) -> Stretch | None:
        """Return the samples and edges from `begin` to `end` in ns, or None without samples."""
        blocks, period = self.between(begin, end), NANOSECONDS / self.load_cell.sample_rate
        if not blocks:
            return None
        time = np.concatenate(
            [block.stamp + (np.arange(len(block.counts)) * period).astype(int) for block in blocks]
        )
        counts = np.concatenate([block.counts for block in blocks])
        inside = (begin <= time) & (time <= end)
        if not inside.any():
            return None
        among = tuple(edge for edge in self.edges if begin <= edge.stamp <= end)
        return Stretch(time[inside], counts[inside], among)

    def empty_belt(self, since: int, until: int) -> NDArray[np.float64]:
        """Return the signal of the longest segment with an empty belt, shape (n,), in kg.

        The mean of the signal is subtracted. The segment is between the stamps `since` and `until`
        in ns. The array is empty if there are no samples.
        """
        blocks = self.between(since, until)
        edges = sorted((e for e in self.edges if e.stamp <= until), key=lambda edge: edge.stamp)
        gap = longest_gap(edges, blocks[0].stamp, blocks[-1].stamp) if blocks else (since, until)
        found = self.stretch(*gap)
        if found is None:
            return np.zeros(0)
        force = found.counts / self.load_cell.counts_per_kg
        return np.asarray(force - force.mean())


def longest_gap(edges: Iterable[EyeEdge], begin: int, end: int) -> tuple[int, int]:
    """Return the start and end in ns of the longest period with an empty belt.

    The period is between `begin` and `end`. The `edges` are in order of time, and include the edges
    before `begin`. The belt counts as empty before the first edge. If the belt is never empty, the
    start and the end are equal.
    """
    longest, since = (begin, begin), begin
    for edge in edges:
        if edge.eye == Eye.INFEED and edge.blocked:
            if edge.stamp - since > longest[1] - longest[0]:
                longest = since, edge.stamp
            since = end  # The next gap begins when the item leaves the belt.
        elif edge.eye == Eye.OUTFEED and not edge.blocked:
            since = max(edge.stamp, begin)
    return (since, end) if end - since > longest[1] - longest[0] else longest

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Buffer of recent samples that can be addressed by sample index and by time."""

from bisect import bisect_right
from dataclasses import dataclass
import math
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, SampleBlock

# Tolerance in samples. Stamps of blocks are rounded to ns. With the tolerance, an edge at the time
# of a sample is always on the same side of the sample, regardless of the size of the blocks.
_INSTANT = 1e-3
# Largest rounding error of the time of a sample in ns.
_ROUNDING = 1
# Duration in s of the start of a stream, to which a looped recording returns.
_BEGINNING = 1.0
# Largest delay of a repeated block in s.
_UNDER_WAY = 2.0
# Shortest duration in s of successive old samples that show that the newest indices are wrong.
_AHEAD = 0.25


@dataclass(frozen=True, slots=True)
class _Anchor:
    """Index of a sample and its time in ns, from which the times of later samples are computed."""

    first_index: int
    stamp: int


class SampleBuffer:
    """Buffer of the last samples of a stream, with the gaps between them.

    `sample_rate` is in Hz. The buffer holds at least the samples of the last `duration`, in s, and
    no block may be longer than this duration. Blocks may come twice or overlap, because samples
    that have already arrived are ignored. If `is_restart` detects that the source has started
    again, the caller must clear the buffer.
    """

    def __init__(self, sample_rate: float, duration: float) -> None:
        self.sample_rate = sample_rate
        self._capacity = max(2, math.ceil(duration * sample_rate))
        # The array has twice the capacity, so that the samples are moved to its front only once per
        # `_capacity` new samples.
        self._counts = np.zeros(2 * self._capacity, np.int32)
        self.clear()

    def clear(self) -> None:
        """Remove all samples and their times."""
        self.start = self.end = 0  # index of the oldest sample, and one past the newest sample
        self.origin: int | None = None  # time of the first sample of the stream in ns
        self._anchors: list[_Anchor] = []
        self._gaps: list[tuple[int, int]] = []
        # Index of the first sample of the stream.
        self._first = 0
        # Number of ignored samples in successive blocks, and one past the index of the last ignored
        # sample.
        self._behind = (0, 0)

    @property
    def empty(self) -> bool:
        """Whether no sample has arrived since `clear`."""
        return self.origin is None

    @property
    def last_stamp(self) -> int:
        """Time of the newest sample in ns; the buffer must not be empty."""
        return self.stamp_at(self.end - 1)

    def stamp_at(self, index: int) -> int:
        """Return the time in ns of the sample at `index`, even if the sample is still to come.

        The buffer must not be empty.
        """
        position = bisect_right(self._anchors, index, key=attrgetter('first_index')) - 1
        anchor = self._anchors[max(position, 0)]
        return anchor.stamp + round((index - anchor.first_index) * NANOSECONDS / self.sample_rate)

    def index_at(self, stamp: int) -> int:
        """Return the index of the first sample, possibly a future one, at or after a time in ns."""
        position = max(bisect_right(self._anchors, stamp, key=attrgetter('stamp')) - 1, 0)
        anchor = self._anchors[position]
        offset = (stamp - anchor.stamp) * self.sample_rate / NANOSECONDS
        index = anchor.first_index + math.ceil(offset - _INSTANT)
        if position + 1 < len(self._anchors):
            index = min(index, self._anchors[position + 1].first_index)
        return index

    def is_restart(self, block: SampleBlock) -> bool:
        """Return whether a block shows that the source has started again.

        The block shows a restart if it is later in time but not in index, or if a looped recording
        returns to the indices of its start. Successive blocks that continue far behind the newest
        samples also show a restart.
        """
        if self.empty or block.first_index >= self.end:
            return False
        later = block.stamp > self.stamp_at(self.end) - NANOSECONDS / (2 * self.sample_rate)
        beginning = block.first_index < self._first + _BEGINNING * self.sample_rate
        behind = self.end - block.first_index - len(block.counts)
        passed_over, end = self._behind
        goes_on = block.first_index == end and passed_over >= _AHEAD * self.sample_rate
        return later or ((beginning or goes_on) and behind > _UNDER_WAY * self.sample_rate)

    def append(self, block: SampleBlock) -> None:
        """Add a block. Samples that are missing before the block are marked as lost.

        Samples of the block that are not newer than the newest sample in the buffer are ignored.
        """
        if self.empty and len(block.counts):
            self.start = self.end = self._first = block.first_index
            self.origin = block.stamp
        first_new = max(self.end, block.first_index)
        counts = block.counts[first_new - block.first_index :]
        if len(counts) == 0:
            ignored, end = self._behind
            before = ignored if block.first_index == end else 0
            self._behind = before + len(block.counts), block.first_index + len(block.counts)
            return
        self._behind = (0, 0)
        lost = first_new - self.end
        if lost > 0:
            self._gaps.append((self.end, first_new))
        # Rounding errors are ignored, so that the times do not depend on the size of the blocks.
        late = block.stamp - self.stamp_at(block.first_index) if self._anchors else math.inf
        if abs(late) > _ROUNDING:
            self._anchors.append(_Anchor(block.first_index, block.stamp))
        if lost >= self._capacity:
            self.start = self.end = first_new
        elif lost > 0:
            self._push(np.zeros(lost, np.int32))
        self._push(counts)
        self._forget()

    def _push(self, counts: NDArray[np.int32]) -> None:
        used = self.end - self.start
        if used + len(counts) > len(self._counts):
            keep = min(used, self._capacity)
            self._counts[:keep] = self._counts[used - keep : used].copy()
            self.start, used = self.end - keep, keep
        self._counts[used : used + len(counts)] = counts
        self.end += len(counts)

    def _forget(self) -> None:
        """Remove the anchors and gaps before the oldest sample."""
        while len(self._anchors) > 1 and self._anchors[1].first_index <= self.start:
            del self._anchors[0]
        self._gaps = [gap for gap in self._gaps if gap[1] > self.start]

    def is_whole(self, begin: int, end: int) -> bool:
        """Return whether the buffer contains all samples with an index in [begin, end)."""
        there = self.start <= begin and end <= self.end
        return there and not any(lost < end and begin < found for lost, found in self._gaps)

    def whole_from(self, begin: int, end: int) -> int:
        """Return the index after the last lost sample in [begin, end).

        If no sample is lost, the result is the larger of `begin` and the index of the oldest
        sample.
        """
        whole = max(begin, self.start)
        for lost_from, lost_to in self._gaps:
            if lost_from < end and lost_to > whole:
                whole = min(lost_to, end)
        return whole

    def read(self, begin: int, end: int) -> NDArray[np.int32]:
        """Return a copy of the samples [begin, end), which must all be in the buffer."""
        return self.look_at(begin, end).copy()

    def look_at(self, begin: int, end: int) -> NDArray[np.int32]:
        """Return a view of the samples [begin, end), which is valid until the next `append`."""
        return self._counts[begin - self.start : end - self.start]

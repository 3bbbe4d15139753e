# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recent past of the sample stream, addressed by sample index and by time."""

from bisect import bisect_right
from dataclasses import dataclass
import math
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, SampleBlock

# An edge stamped at the very instant of a sample must fall on the same side of it however the
# blocks were cut, although each block's stamp is rounded to a nanosecond.
_INSTANT = 1e-3  # samples
# By which the stamps of blocks of one clock may contradict each other: each is rounded.
_ROUNDING = 1  # ns
# A block of the first second that comes so much later than its time is no block that was late.
_BEGINNING = 1.0  # s
_UNDER_WAY = 2.0  # s
_AHEAD = 0.25  # s of samples that go on behind the newest ones, after which these were none


@dataclass(frozen=True, slots=True)
class _Anchor:
    """Where a block tied the index to the clock."""

    first_index: int
    stamp: int


class SampleBuffer:
    """Keep the last samples of a stream, of `duration` s at `sample_rate` Hz, with its gaps.

    Blocks may come twice or overlap: samples that are there already are passed over. A block that
    is later in time but not in index, or with which the stream began long ago, comes from a source
    that has started again: the caller asks `is_restart`, and clears the buffer.
    """

    def __init__(self, sample_rate: float, duration: float) -> None:
        self.sample_rate = sample_rate
        self._capacity = max(2, math.ceil(duration * sample_rate))
        # Twice the capacity, so that the kept part moves to the front only once per capacity.
        self._counts = np.zeros(2 * self._capacity, np.int32)
        self.clear()

    def clear(self) -> None:
        """Forget all samples, and the clock and index that they had."""
        self.start = self.end = 0  # index of the oldest sample, and of the next one to come
        self.empty = True
        self.origin: int | None = None  # ns, time of the first sample of all
        self._anchors: list[_Anchor] = []
        self._gaps: list[tuple[int, int]] = []
        self._first = 0  # index of the first sample of all
        self._behind = (0, 0)  # samples passed over, each block after the other, and their end

    @property
    def last_stamp(self) -> int | None:
        """Time of the newest sample, ns; None if there is none."""
        return None if self.empty else self.stamp_at(self.end - 1)

    def stamp_at(self, index: int) -> int:
        """Return the time of a sample in ns."""
        anchor = self._anchors[0]
        if len(self._anchors) > 1:  # where all blocks are of one clock there is but one
            position = bisect_right(self._anchors, index, key=attrgetter('first_index')) - 1
            anchor = self._anchors[max(position, 0)]
        return anchor.stamp + round((index - anchor.first_index) * NANOSECONDS / self.sample_rate)

    def index_at(self, stamp: int) -> int:
        """Return the index of the first sample at or after `stamp`; it may be yet to come."""
        position = 0
        if len(self._anchors) > 1:
            position = max(bisect_right(self._anchors, stamp, key=attrgetter('stamp')) - 1, 0)
        anchor = self._anchors[position]
        offset = (stamp - anchor.stamp) * self.sample_rate / NANOSECONDS
        index = anchor.first_index + math.ceil(offset - _INSTANT)
        if position + 1 < len(self._anchors):
            index = min(index, self._anchors[position + 1].first_index)
        return index

    def is_restart(self, block: SampleBlock) -> bool:
        """Tell whether the source has started again: later in time, but not in index.

        Or with the indices that the stream began with, too late for a block that was under way:
        that is a recording played in a loop, at any time. Or it goes on far behind the newest
        samples, which then were of nothing that has happened yet.
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
        """Take a block; samples between it and the last one are remembered as lost."""
        if self.empty and len(block.counts):
            self.start = self.end = self._first = block.first_index
            self.origin = block.stamp
        first_new = max(self.end, block.first_index)
        counts = block.counts[first_new - block.first_index :]
        if len(counts) == 0:
            self._pass_over(block)
            return
        self._behind = (0, 0)
        lost = first_new - self.end
        if lost > 0:
            self._gaps.append((self.end, first_new))
        if not self._is_on_clock(block):
            self._anchors.append(_Anchor(block.first_index, block.stamp))
        self.empty = False
        if lost >= self._capacity:
            self.start = self.end = first_new
        elif lost > 0:
            self._push(np.zeros(lost, np.int32))
        self._push(counts)
        self._forget()

    def _pass_over(self, block: SampleBlock) -> None:
        passed_over, end = self._behind
        before = passed_over if block.first_index == end else 0
        self._behind = before + len(block.counts), block.first_index + len(block.counts)

    def _is_on_clock(self, block: SampleBlock) -> bool:
        """Tell whether the blocks before say the same time of a block, but for rounding.

        If they do, the index is not tied to the clock again: otherwise the nanosecond that a
        sample gets would depend on how the blocks were cut.
        """
        return not self.empty and abs(block.stamp - self.stamp_at(block.first_index)) <= _ROUNDING

    def _push(self, counts: NDArray[np.int32]) -> None:
        skipped = len(counts) - self._capacity
        if skipped > 0:
            counts = counts[skipped:]
            self.start = self.end = self.end + skipped
        used = self.end - self.start
        if used + len(counts) > len(self._counts):
            keep = min(used, self._capacity)
            self._counts[:keep] = self._counts[used - keep : used].copy()
            self.start, used = self.end - keep, keep
        self._counts[used : used + len(counts)] = counts
        self.end += len(counts)

    def _forget(self) -> None:
        """Drop anchors and gaps that lie before the oldest sample."""
        while len(self._anchors) > 1 and self._anchors[1].first_index <= self.start:
            del self._anchors[0]
        while self._gaps and self._gaps[0][1] <= self.start:
            del self._gaps[0]

    def is_whole(self, begin: int, end: int) -> bool:
        """Tell whether every sample of [begin, end) is there."""
        there = self.start <= begin and end <= self.end
        return there and not any(lost < end and begin < found for lost, found in self._gaps)

    def whole_from(self, begin: int, end: int) -> int:
        """Return the smallest index from `begin` on with no sample lost between it and `end`."""
        whole = max(begin, self.start)
        for lost_from, lost_to in self._gaps:
            if lost_from < end and lost_to > whole:
                whole = min(lost_to, end)
        return whole

    def read(self, begin: int, end: int) -> NDArray[np.int32]:
        """Return a copy of the samples [begin, end), all of which must be there."""
        return self.look_at(begin, end).copy()

    def look_at(self, begin: int, end: int) -> NDArray[np.int32]:
        """Return the samples [begin, end), which are others as soon as the next block comes."""
        return self._counts[begin - self.start : end - self.start]

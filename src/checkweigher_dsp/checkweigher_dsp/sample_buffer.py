"""The recent past of the sample stream, addressed by sample index and by time."""

from bisect import bisect_right
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.records import NANOSECONDS, SampleBlock

# An edge stamped at the very instant of a sample must fall on the same side of it however the
# blocks were cut, although each block's stamp is rounded to a nanosecond.
_INSTANT = 1e-3  # samples
# By which the stamps of blocks of one clock may contradict each other: each is rounded.
_ROUNDING = 1  # ns


# A block of the first second that comes so much later than its time is no block that was late.
_BEGINNING = 1.0  # s
_UNDER_WAY = 2.0  # s


@dataclass(frozen=True, slots=True)
class _Anchor:
    """Where a block tied the index to the clock."""

    first_index: int
    stamp: int


class SampleBuffer:
    """Keep the last samples of a stream, with its gaps.

    Parameters
    ----------
    sample_rate : float
        Hz.
    duration : float
        s, how far back samples can be read.

    Notes
    -----
    Blocks may come twice or overlap: samples that are there already are passed over. A block that
    is later in time but not in index, or with which the stream began long ago, comes from a source
    that has started again: the caller asks `is_restart` and begins with a new buffer.
    """

    def __init__(self, sample_rate: float, duration: float) -> None:
        self.sample_rate = sample_rate
        self._capacity = max(2, math.ceil(duration * sample_rate))
        # Twice the capacity, so that the kept part moves to the front only once per capacity.
        self._counts = np.zeros(2 * self._capacity, np.int32)
        self._used = 0
        self._start = 0
        self._anchors: list[_Anchor] = []
        self._anchor_stamps: list[int] = []
        self._gaps: list[tuple[int, int]] = []
        self._origin: int | None = None
        self._first = 0  # index of the first sample of all

    @property
    def start(self) -> int:
        """Index of the oldest sample that is kept."""
        return self._start

    @property
    def end(self) -> int:
        """Index of the next sample to come."""
        return self._start + self._used

    @property
    def empty(self) -> bool:
        """Whether no sample has come yet."""
        return not self._anchors

    @property
    def origin(self) -> int | None:
        """Time of the first sample of all, ns; None if there is none."""
        return self._origin

    @property
    def last_stamp(self) -> int | None:
        """Time of the newest sample, ns; None if there is none."""
        return None if self.empty else self.stamp_at(self.end - 1)

    def stamp_at(self, index: int) -> int:
        """Return the time of a sample in ns."""
        position = 0
        if len(self._anchors) > 1:  # where all blocks are of one clock there is but one
            position = bisect_right(self._anchors, index, key=lambda anchor: anchor.first_index) - 1
        anchor = self._anchors[max(position, 0)]
        return anchor.stamp + round((index - anchor.first_index) * NANOSECONDS / self.sample_rate)

    def index_at(self, stamp: int) -> int:
        """Return the index of the first sample at or after `stamp`; it may be yet to come."""
        position = max(bisect_right(self._anchor_stamps, stamp) - 1, 0)
        anchor = self._anchors[position]
        offset = (stamp - anchor.stamp) * self.sample_rate / NANOSECONDS
        index = anchor.first_index + math.ceil(offset - _INSTANT)
        if position + 1 < len(self._anchors):
            index = min(index, self._anchors[position + 1].first_index)
        return index

    def is_restart(self, block: SampleBlock) -> bool:
        """Tell whether the source has started again: later in time, but not in index.

        Or, whatever the time says, with the indices that the stream began with, too late for a
        block that was under way: a recording that is played in a loop.
        """
        if self.empty or block.first_index >= self.end:
            return False
        later = block.stamp > self.stamp_at(self.end) - NANOSECONDS / (2 * self.sample_rate)
        beginning = block.first_index < self._first + _BEGINNING * self.sample_rate
        behind = self.end - block.first_index - len(block.counts)
        return later or (beginning and behind > _UNDER_WAY * self.sample_rate)

    def append(self, block: SampleBlock) -> None:
        """Take a block; samples between it and the last one are remembered as lost."""
        if len(block.counts) == 0:
            return
        if self.empty:
            self._start = self._first = block.first_index
            self._origin = block.stamp
        first_new = max(self.end, block.first_index)
        counts = block.counts[first_new - block.first_index :]
        if len(counts) == 0:
            return
        lost = first_new - self.end
        if lost > 0:
            self._gaps.append((self.end, first_new))
        if not self._is_on_clock(block):
            self._anchors.append(_Anchor(block.first_index, block.stamp))
            self._anchor_stamps.append(block.stamp)
        if lost >= self._capacity:
            self._start, self._used = first_new, 0
        elif lost > 0:
            self._push(np.zeros(lost, np.int32))
        self._push(counts)
        self._forget()

    def _is_on_clock(self, block: SampleBlock) -> bool:
        """Tell whether the blocks before say the same time of a block, but for rounding.

        If they do it is not tied anew: which nanosecond a sample gets would depend on how the
        blocks were cut.
        """
        if self.empty:
            return False
        return abs(block.stamp - self.stamp_at(block.first_index)) <= _ROUNDING

    def _push(self, counts: NDArray[np.int32]) -> None:
        counts_kept = counts[-self._capacity :]
        skipped = len(counts) - len(counts_kept)
        if skipped:
            self._start, self._used = self.end + skipped, 0
        if self._used + len(counts_kept) > len(self._counts):
            keep = min(self._used, self._capacity)
            self._counts[:keep] = self._counts[self._used - keep : self._used].copy()
            self._start, self._used = self.end - keep, keep
        self._counts[self._used : self._used + len(counts_kept)] = counts_kept
        self._used += len(counts_kept)

    def _forget(self) -> None:
        """Drop anchors and gaps that lie before the oldest sample."""
        while len(self._anchors) > 1 and self._anchors[1].first_index <= self._start:
            del self._anchors[0], self._anchor_stamps[0]
        while self._gaps and self._gaps[0][1] <= self._start:
            del self._gaps[0]

    def is_whole(self, begin: int, end: int) -> bool:
        """Tell whether every sample of [begin, end) is there."""
        return (
            self._start <= begin
            and end <= self.end
            and not any(lost_from < end and begin < lost_to for lost_from, lost_to in self._gaps)
        )

    def whole_from(self, begin: int, end: int) -> int:
        """Return the smallest index from `begin` on with no sample lost between it and `end`."""
        whole = max(begin, self._start)
        for lost_from, lost_to in self._gaps:
            if lost_from < end and lost_to > whole:
                whole = min(lost_to, end)
        return whole

    def read(self, begin: int, end: int) -> NDArray[np.int32]:
        """Return a copy of the samples [begin, end), all of which must be there."""
        return self._counts[begin - self._start : end - self._start].copy()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of the readings of a device to blocks of samples with index and stamp."""

from collections.abc import Iterator, Sequence
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, SampleBlock
from checkweigher_driver.serial.reads import Read
from checkweigher_driver.serial.sample_clock import SampleClock


class BlockMaker:
    """Conversion of reads to blocks of samples.

    The index continues after a break of the connection, and jumps by the number of lost samples.
    Blocks are held back while their stamps are uncertain. Stamps are uncertain for 1 s at the
    start, while reads are over 20 ms late, and for 1 s after the host clock was set back by more
    than 5 ms. If a step of the host clock exceeds 20 ms, or if the decoder has not detected a
    loss of more than 20 ms of samples, an item on the belt gets the decision FAULT.

    `latency` is the shortest time in s from a sample to the read that returns it. `limits` contains
    the lower and the upper limit of the converter in counts.
    """

    def __init__(self, sample_rate: float, latency: float, limits: tuple[int, int]) -> None:
        self._rate = sample_rate
        self._latency = round(NANOSECONDS * latency)
        self._limits = limits
        self._clock = SampleClock(sample_rate, latency=latency)
        self._held: list[tuple[int, NDArray[np.int32]]] = []
        self.index = 0  # index of the next sample
        self._lost = self._samples = 0

    def resume(self, reads: Sequence[Read]) -> None:
        """Increase the index by the number of samples that were lost in a break.

        `reads` are the first reads after the break. The number of lost samples is computed from the
        read with the smallest delay, and is at least 1.
        """
        index, least = self.index - 1, math.inf
        for read in reads:
            index += len(read.values.counts) + int(read.values.lost.sum())
            least = min(least, read.at - self._latency - self._clock.stamp(index))
        self._jump(max(1, math.floor(least * self._rate / NANOSECONDS)))

    def blocks(self, read: Read) -> Iterator[SampleBlock]:
        """Convert a read to blocks, and yield the blocks whose stamps are certain now.

        The yielded blocks include those that were held back before. A new block begins after each
        gap in the samples. A negative reading that overflows is replaced by the lower limit of the
        converter, any other reading that overflows by the upper limit.
        """
        values, (low, high) = read.values, self._limits
        at_limit = np.where(values.counts < 0, low, high)
        counts = np.where(values.overflow, at_limit, values.counts).astype(np.int32)
        gaps = np.flatnonzero(values.lost[1:]) + 1
        lost = values.lost[np.r_[0, gaps]].tolist()
        for lost_before, piece in zip(lost, np.split(counts, gaps), strict=True):
            self._jump(lost_before)
            self._clock.add(self.index, len(piece), read.at)
            self._held.append((self.index, piece))
            self.index += len(piece)
            self._samples += len(piece)
            if self._clock.settled:
                for first, kept in self._held:
                    yield SampleBlock(self._clock.stamp(first), first, kept)
                self._held = []

    def _jump(self, lost: int) -> None:
        self.index += lost
        self._lost += lost

    def figures(self) -> dict[str, float]:
        """Return values on samples, losses and the clock for the diagnostics, by name."""
        return {'samples': self._samples, 'samples lost': self._lost, **self._clock.figures()}

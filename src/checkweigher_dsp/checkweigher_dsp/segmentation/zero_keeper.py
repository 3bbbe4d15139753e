# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Zero of the scale, which is tracked from product to product and set on request."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, LoadCell, ZeroChange
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_tracking import Zero, ZeroLimits, ZeroTracker

_PATIENCE = 10.0  # duration of the signal in s, beyond edge_lateness, after which a request fails
Span = tuple[int, int]  # index of the first sample, and one past the last sample


@dataclass(frozen=True, slots=True)
class ZeroAnswer:
    """Answer to a request to set the zero."""

    text: str  # message to the user
    change: ZeroChange | None = None  # change of the zero, or None if the zero was not set


class ZeroKeeper:
    """Zero of the scale, with the requests to set it."""

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters, buffer: SampleBuffer
    ) -> None:
        sensitivity = abs(load_cell.counts_per_kg)
        self._load_cell = load_cell
        self._limits = parameters
        self._buffer = buffer
        limits = parameters.zero_range, parameters.zero_rate, parameters.zero_stability
        self._tracker = ZeroTracker(
            load_cell.zero_counts,
            sensitivity * parameters.zero_initial_std_dev,
            sensitivity * parameters.zero_random_walk,
            load_cell.sample_rate,
            ZeroLimits(*(sensitivity * limit for limit in limits)),
            sensitivity * parameters.zero_drift,
        )
        self._requested: int | None = None  # index of the first sample after the request
        self._why_not = ''
        # Answer to the last request. The answer is None while a request waits, and before the first
        # request.
        self.answer: ZeroAnswer | None = None

    @property
    def zero(self) -> Zero:
        """Current zero."""
        return self._tracker.zero

    @property
    def is_requested(self) -> bool:
        """Whether a request to set the zero waits for an empty belt."""
        return self._requested is not None

    def update(self, time: float, counts: NDArray[np.int32], settled: bool) -> Zero:
        """Update the zero by the empty belt before an item; see `ZeroTracker.update`."""
        return self._tracker.update(time, counts, settled)

    def request(self) -> None:
        """Request that the next samples of an empty belt at rest set the zero."""
        self._requested = 0 if self._buffer.empty else self._buffer.end
        self._why_not = 'the belt was not empty'
        self.answer = None

    def try_to_set(self, empty: Span | None, least: float) -> None:
        """Answer a request if the belt has been empty for long enough, or after a timeout.

        `empty` is the span of the samples of an empty belt after the ring-down, or None if the belt
        is not empty. `least` is the shortest sufficient duration of the span in s.
        """
        if self._requested is None:
            return
        buffer, rate = self._buffer, self._load_cell.sample_rate
        if empty is not None:
            begin, end = max(empty[0], self._requested), empty[1]
            count = min(end - begin, round(self._limits.zeroing_time * rate))
            if count >= max(2, round(least * rate)):
                self.answer = self._set(end - count, end)
        late = buffer.end - self._requested > (_PATIENCE + self._limits.edge_lateness) * rate
        if self.answer is None and late:
            self.answer = ZeroAnswer(f'{self._why_not} within {_PATIENCE:g} s: not zeroed')
        if self.answer is not None:
            self._requested = None

    def _set(self, begin: int, end: int) -> ZeroAnswer | None:
        """Set the zero by the samples [begin, end), and return the answer to the request.

        If the zero would be outside ``zero_range``, it is not set, and the answer has no change.
        Returns None if samples were lost or the belt was not at rest, so that the request waits.
        """
        if not self._buffer.is_whole(begin, end):
            self._why_not = 'samples were lost'
            return None
        stamp, before = self._buffer.stamp_at(end), self.zero.counts
        reading = self._tracker.set(stamp / NANOSECONDS, self._buffer.look_at(begin, end))
        if reading is None:
            self._why_not = 'the empty belt was not at rest'
            return None
        cell = self._load_cell
        mass = (reading - cell.zero_counts) / cell.counts_per_kg
        if not self._tracker.is_in_range(reading):
            return ZeroAnswer(
                f'the empty belt reads {mass:.6f} kg, beyond zero_range '
                f'{self._limits.zero_range:g} kg: not zeroed'
            )
        previous = (before - cell.zero_counts) / cell.counts_per_kg
        change = ZeroChange(stamp, mass, previous, self.zero.std_dev / abs(cell.counts_per_kg))
        return ZeroAnswer(f'zeroed at {mass:.6f} kg from the zero of calibration', change)

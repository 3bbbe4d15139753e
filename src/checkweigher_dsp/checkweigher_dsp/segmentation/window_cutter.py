# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cutting of weigh windows from the samples of each item."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, LoadCell, WeighWindow, seconds
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.failures import Failures
from checkweigher_dsp.items.item import TrackedItem
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.load_check import LoadCheck
from checkweigher_dsp.segmentation.motion_check import MotionCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_keeper import ZeroKeeper
from checkweigher_dsp.segmentation.zero_tracking import Zero
from checkweigher_dsp.signal.rise_lag import RiseLag, rise_lag

_BEFORE_RISE = 0.4  # time in s before t1 at which the search for the rise of the load begins

_Identity = tuple[int, int | None, int | None, int | None, float, float, float]


@dataclass(frozen=True, slots=True)
class _Place:
    """Times of the edges of an item in ns, and the indices of the samples at these times.

    The indices include the shift, which is the lag of the load behind the edges.
    """

    t1: int
    t2: int
    t3: int
    entry: int  # index at t1
    begin: int  # index at t2
    end: int  # index at t3
    trail_end: int  # index one past the last sample after t3 that the window shall contain
    shift: int  # shift in ns


class WindowCutter:
    """Cutter of the weigh windows of items.

    An item waits until its samples have arrived. Before the window of an item is cut, the zero is
    updated by the empty belt before the item.
    """

    def __init__(
        self,
        load_cell: LoadCell,
        parameters: SegmenterParameters,
        buffer: SampleBuffer,
        zero: ZeroKeeper,
        failures: Failures,
    ) -> None:
        self._failures = failures
        self._load_cell = load_cell
        self._parameters = parameters
        self._buffer = buffer
        self._zero = zero
        self.motion = MotionCheck(load_cell.weigh_length, parameters)
        self.edge_check = EdgeCheck(parameters)
        self._load_check = LoadCheck()
        self._waiting: list[TrackedItem] = []
        self.count = 0  # number of windows so far
        self.jumped = False  # whether the samples begin after a jump of the clock

    def take(self, items: Iterable[TrackedItem]) -> None:
        """Check the start, speed and length of items, and let the items wait for their samples."""
        items = list(items)
        self._failures.each(self._check, lambda item: item.fault(Reason.STAGE_FAILED), items)
        self._waiting += items

    def _check(self, item: TrackedItem) -> None:
        self._check_start(item)
        self.motion.check(item)

    def fault_waiting(self, reason: Reason, before: float = math.inf) -> bool:
        """Add a fault to the waiting items that entered before a time in ns.

        Returns whether a fault was added to an item.
        """
        late = [item for item in self._waiting if item.entered < before]
        for item in late:
            item.fault(reason)
        return bool(late)

    def cut(self, *, wait: bool = True) -> list[WeighWindow]:
        """Return the windows of the items whose samples have arrived.

        If `wait` is true, the samples after t3 must have arrived too, and a fault waits for the
        first sample of the stream. A fault does not wait for its own samples, because its window
        contains no samples.
        """
        if not self._waiting:  # as after most blocks and edges
            return []
        found = self._failures.each(
            partial(self._cut, wait=wait),
            lambda item: self._fault(item, Reason.STAGE_FAILED),
            self._waiting,
        )
        pairs = zip(self._waiting, found, strict=True)
        self._waiting = [item for item, window in pairs if window is None]
        windows = [window for window in found if window is not None]
        self.count += len(windows)
        return windows

    def _cut(self, item: TrackedItem, *, wait: bool) -> WeighWindow | None:
        if self._buffer.empty and wait:
            return None
        self._check_start(item)
        if item.faults or item.edges is None:
            return self._fault(item, *item.faults)
        place = self._find_place(item, *item.edges, wait=wait)
        if place is None:
            return None
        reason = self._check_place(place) or self._check_rise(item, place)
        if reason is not None:
            return self._fault(item, reason)
        if item.shift and item.shift != place.shift:
            return self._cut(item, wait=wait)
        return self._make_window(item, place)

    def _samples(self, duration: float) -> int:
        return round(duration * self._load_cell.sample_rate)

    def _find_place(
        self, item: TrackedItem, t1: int, t2: int, t3: int, *, wait: bool
    ) -> _Place | None:
        if self._buffer.empty:
            return None
        shift = item.shift or 0
        entry, begin, end = (self._buffer.index_at(stamp + shift) for stamp in (t1, t2, t3))
        # The samples after t3 end at the latest when the item has left.
        left = self._buffer.index_at(t3 + shift + item.length)
        trail_end = max(min(end + self._samples(self._parameters.trail_time), left), end)
        if self._buffer.end < (trail_end if wait else end):
            return None
        return _Place(t1, t2, t3, entry, begin, end, trail_end, shift)

    def _check_place(self, place: _Place) -> Reason | None:
        """Return the reason why the samples cannot be weighed, or None if they can."""
        if place.end - place.begin < self._parameters.min_window:
            return Reason.WINDOW_TOO_SHORT
        if reason := self._check_samples(place.entry, place.end):
            return reason
        cell, counts = self._load_cell, self._buffer.look_at(place.begin, place.end)
        load = float(np.add.reduce(counts, dtype=np.int64) / len(counts)) - cell.zero_counts
        return Reason.OVERLOAD if abs(load / cell.counts_per_kg) > cell.capacity else None

    def _make_window(self, item: TrackedItem, place: _Place) -> WeighWindow:
        """Return the window of an item, as a fault if the zero or the load is not valid."""
        buffer, cell = self._buffer, self._load_cell
        entry, begin, end = place.entry, place.begin, place.end
        empty, settled = self._empty_belt(item, entry)
        if settled:
            self._zero.try_to_set((entry - len(empty), entry), self._parameters.zero_moment)
        zero = self._zero.update(seconds(place.t1), empty, settled)
        if not zero.trusted:
            return self._fault(item, Reason.ZERO_OUT_OF_RANGE)
        first = buffer.whole_from(entry - self._samples(self._parameters.lead_time), entry)
        alone_from = min(max(self._alone_from(item, first, begin, place.shift), first), begin)
        before, window = buffer.look_at(min(alone_from, entry), entry), buffer.look_at(begin, end)
        if not self._load_check.is_steady(window, before, zero.counts):
            return self._fault(item, Reason.DISTANCE_FAULT)
        trail_end = min(place.trail_end, buffer.end)
        is_sound = self._check_samples(end, trail_end) is None
        # Compute the stamp of the window from the sample at t2, so that an error of the sample rate
        # does not shift the window.
        lead = round((begin - first) * NANOSECONDS / cell.sample_rate)
        return WeighWindow(
            *self._identity(item),
            sample_rate=cell.sample_rate,
            counts_per_kg=cell.counts_per_kg,
            zero_counts=cell.zero_counts,
            zero=zero.counts,
            zero_std_dev=_zero_std_dev(item, place, zero, window),
            first_index=first,
            stamp=buffer.stamp_at(begin) - place.shift - lead,
            empty_begin=alone_from - first,
            window_begin=begin - first,
            window_end=end - first,
            counts=buffer.read(first, trail_end if is_sound else end),
        )

    def _fault(self, item: TrackedItem, *reasons: Reason) -> WeighWindow:
        return WeighWindow(*self._identity(item), reasons=tuple(reason.value for reason in reasons))

    def _identity(self, item: TrackedItem) -> _Identity:
        """Return the first fields of a window: item number, edges, speed, length and line speed."""
        speed, length = self.motion.measure(item)
        line_speed = speed
        if math.isnan(speed) and item.usual_transit is not None:
            line_speed = self._load_cell.weigh_length / seconds(item.usual_transit)
        return item.item_id, item.t1, item.t2, item.t3, speed, length, line_speed

    def _check_rise(self, item: TrackedItem, place: _Place) -> Reason | None:
        """Set the shift of an item, or return the reason why its edges contradict the samples.

        Returns None if there is no contradiction. Nothing is checked if ``rise_lag_tolerance`` is 0
        or the shift is already set.
        """
        if not self._parameters.rise_lag_tolerance or item.shift is not None:
            return None
        buffer, rate, last = self._buffer, self._load_cell.sample_rate, place.end - 1
        span = seconds(buffer.stamp_at(last) - buffer.stamp_at(place.entry))
        if abs(span - (last - place.entry) / rate) > self._parameters.rise_lag_tolerance:
            return Reason.CLOCK_JUMP
        seen = self._see_rise(item, place)
        begins_late = seconds(place.t1 - (buffer.origin or 0)) < _BEFORE_RISE
        if self.jumped and begins_late and not seen.is_known:
            # Do not trust the edges. The clock of the eyes may have jumped by a different amount
            # than the clock of the samples, which cannot be checked without a visible rise.
            return Reason.CLOCK_JUMP
        shift = self.edge_check.check(seen, *self.motion.measure(item))
        if shift is None:
            return self._contradiction(place, seen)
        item.shift = round(NANOSECONDS * shift)
        item.shift_std_dev = self.edge_check.shift_std_dev
        return None

    def _contradiction(self, place: _Place, seen: RiseLag) -> Reason:
        """Return the reason why the rise of the load contradicts the edges.

        The reason is EDGE_MISMATCH if the load after the rise is constant, otherwise
        DISTANCE_FAULT, because several items are on the belt.
        """
        late = self._samples(max(seen.lag, 0.0)) if seen.is_known else 0
        window = self._buffer.look_at(min(place.begin + late, place.end), place.end)
        alone = self._load_check.is_steady(window, window[:0], self._zero.zero.counts)
        return Reason.EDGE_MISMATCH if alone else Reason.DISTANCE_FAULT

    def _see_rise(self, item: TrackedItem, place: _Place) -> RiseLag:
        """Return the lag of the rise of the load behind the edges.

        The lag is unknown if there is no sample before t1 at which the belt was surely empty.
        """
        buffer, cell = self._buffer, self._load_cell
        entry, begin, end = place.entry, place.begin, place.end
        earliest = buffer.whole_from(entry - self._samples(_BEFORE_RISE), entry)
        first = max(self._alone_from(item, earliest, begin), earliest)
        if first >= entry:
            return RiseLag()
        time = np.arange(first - begin, end - begin) / cell.sample_rate
        time += seconds(buffer.stamp_at(begin) - place.t1)
        force = buffer.look_at(first, end) / cell.counts_per_kg
        return rise_lag(force, time, seconds(place.t2 - place.t1), seconds(place.t3 - place.t1))

    def _alone_from(self, item: TrackedItem, first: int, begin: int, shift: int = 0) -> int:
        """Return the index of the first sample at which no other item is on the belt.

        The index is `first` if there was no other item, and `begin` if another item was there at t1
        and the time of its departure is unknown. `shift` is the lag of the load behind the edges in
        ns.
        """
        if item.left_before is None:
            return begin if item.others_there else first
        return self._buffer.index_at(item.left_before + shift)

    def _check_start(self, item: TrackedItem) -> None:
        """Add a fault to an item that may have entered before the first sample of the stream."""
        origin, parameters = self._buffer.origin, self._parameters
        margin = (
            parameters.max_transit(self._load_cell.weigh_length)
            if item.t1 is None
            else round(NANOSECONDS * parameters.debounce_time)
        )
        if origin is not None and item.entered <= origin + margin:
            item.fault(Reason.START_UP)

    def _check_samples(self, begin: int, end: int) -> Reason | None:
        if not self._buffer.is_whole(begin, end):
            return Reason.SAMPLES_LOST
        counts, limits = self._buffer.look_at(begin, end), self._load_cell
        if len(counts) and (
            int(np.minimum.reduce(counts)) <= limits.min_counts
            or int(np.maximum.reduce(counts)) >= limits.max_counts
        ):
            return Reason.SATURATION
        return None

    def _empty_belt(self, item: TrackedItem, entry: int) -> tuple[NDArray[np.int32], bool]:
        """Return the samples of the empty belt before an item, (n,) in counts.

        Also returns whether these samples begin after the ring-down of the previous item. Samples
        of the ring-down are included only if there are too few samples after it. If another item
        may have been at the outfeed eye at t1, n is 0 and the second result is False.
        """
        buffer, parameters = self._buffer, self._parameters
        if item.others_there:
            return buffer.look_at(entry, entry), False
        begin = earliest = entry - self._samples(parameters.zero_time)
        if item.left_before is not None:
            settle_time = round(NANOSECONDS * parameters.settle_time)
            begin = max(begin, buffer.index_at(item.left_before + settle_time))
            earliest = max(earliest, buffer.index_at(item.left_before))
        begin = min(buffer.whole_from(begin, entry), entry)
        least = parameters.zero_moment * self._load_cell.sample_rate
        if entry - begin < least:
            earliest = min(buffer.whole_from(earliest, entry), entry)
            if least <= entry - earliest:
                return buffer.look_at(earliest, entry), False
        return buffer.look_at(begin, entry), True


def _zero_std_dev(item: TrackedItem, place: _Place, zero: Zero, window: NDArray[np.int32]) -> float:
    """Return the standard deviation of the zero in counts, including the effect of the shift.

    If a load M is removed from the signal at a time that is wrong by d, the area M d remains in the
    signal. Smoothing spreads this area over about twice the transit.
    """
    if not item.shift_std_dev:
        return zero.std_dev
    load = float(np.mean(window)) - zero.counts
    spread = load * item.shift_std_dev / (2 * seconds(place.t3 - place.t1))
    return math.hypot(zero.std_dev, spread)

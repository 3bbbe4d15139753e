# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cutting the samples of each item out of the stream, once they have come and if they are sound."""

from collections.abc import Iterable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, LoadCell, WeighWindow, seconds
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.item import TrackedItem
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.load_check import LoadCheck
from checkweigher_dsp.segmentation.motion_check import MotionCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_keeper import ZeroKeeper
from checkweigher_dsp.segmentation.zero_tracking import Zero
from checkweigher_dsp.signal.rise_lag import RiseLag, rise_lag

_BEFORE_RISE = 0.4  # s before t1 in which a rise is looked for

_Identity = tuple[int, int | None, int | None, int | None, float, float, float]


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the samples of an item are, as indices, once its edges are moved by its shift."""

    entry: int  # t1
    begin: int  # t2
    end: int  # t3
    trail_end: int  # of the samples to wait for after t3
    shift: int  # ns, by which the rise is later than the edges
    doubt: float  # s, standard deviation of the shift


class WindowCutter:
    """Turn items into weigh windows; `count` is their number so far.

    An item waits until its samples are there. Before it is cut, the zero follows the empty belt in
    front of it.
    """

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters,
        buffer: SampleBuffer, zero: ZeroKeeper,
    ) -> None:  # fmt: skip
        self._load_cell = load_cell
        self._parameters = parameters
        self._buffer = buffer
        self._zero = zero
        self.motion = MotionCheck(load_cell.weigh_length, parameters)
        self.edge_check = EdgeCheck(parameters)
        self._load_check = LoadCheck()
        self._debounce = round(NANOSECONDS * parameters.debounce_time)
        self._max_transit = parameters.max_transit(load_cell.weigh_length)
        self._settle_time = round(NANOSECONDS * parameters.settle_time)
        self._zero_span = round(parameters.zero_time * load_cell.sample_rate)
        self._lead = round(parameters.lead_time * load_cell.sample_rate)
        self._trail = round(parameters.trail_time * load_cell.sample_rate)
        # Shift of items that wait and were checked, ns, and its standard deviation, s.
        self._shifts: dict[int, tuple[int, float]] = {}
        self._waiting: list[TrackedItem] = []
        self.count = 0
        self.jumped = False  # whether the samples begin where their clock jumped

    def take(self, items: Iterable[TrackedItem]) -> None:
        """Let items wait for their samples."""
        for item in items:
            self._check_start(item)
            self.motion.check(item)
            self._waiting.append(item)

    def fault_waiting(self, reason: Reason, before: float = math.inf) -> bool:
        """Fault the items that wait and entered before a time, ns; tell whether there are any."""
        late = [item for item in self._waiting if item.entered < before]
        for item in late:
            item.fault(reason)
        return bool(late)

    def cut(self, *, wait: bool = True) -> list[WeighWindow]:
        """Return the windows of the items whose samples are there.

        Without `wait` the samples up to t3 are enough.
        """
        if not self._waiting:
            return []
        cut = [(item, self._cut(item, wait=wait)) for item in self._waiting]
        self._waiting = [item for item, window in cut if window is None]
        kept = {item.item_id for item in self._waiting}
        self._shifts = {item: shift for item, shift in self._shifts.items() if item in kept}
        windows = [window for _, window in cut if window is not None]
        self.count += len(windows)
        return windows

    def _cut(self, item: TrackedItem, *, wait: bool) -> WeighWindow | None:
        """Return the window of an item, None while its samples are yet to come."""
        if self._buffer.empty and wait:
            return None
        self._check_start(item)
        if item.faults or item.t1 is None or item.t2 is None or item.t3 is None:
            return self._fault(item, *item.faults)
        if self._buffer.empty:
            return None
        place = self._find_place(item, item.t1, item.t2, item.t3)
        if self._buffer.end < (place.trail_end if wait else place.end):
            return None
        reason = self._check_place(place)
        if reason is not None:
            return self._fault(item, reason)
        if self._parameters.rise_lag_tolerance and item.item_id not in self._shifts:
            found = self._find_shift(item, place.entry, place.begin, place.end)
            if isinstance(found, Reason):
                return self._fault(item, found)
            self._shifts[item.item_id] = found, self.edge_check.doubt
            return self._cut(item, wait=wait)
        zero = self._zero_before(item, seconds(item.t1), place.entry)
        if not zero.trusted:
            return self._fault(item, Reason.ZERO_OUT_OF_RANGE)
        return self._make_window(item, place, zero)

    def _find_place(self, item: TrackedItem, t1: int, t2: int, t3: int) -> _Place:
        shift, doubt = self._shifts.get(item.item_id, (0, 0.0))
        entry, begin, end = (self._buffer.index_at(stamp + shift) for stamp in (t1, t2, t3))
        trail_end = self._trail_end(t3 + shift + item.length, end)
        return _Place(entry, begin, end, trail_end, shift, doubt)

    def _check_place(self, place: _Place) -> Reason | None:
        """Return why the samples of a place cannot be weighed, None if they can."""
        if place.end - place.begin < self._parameters.min_window:
            return Reason.WINDOW_TOO_SHORT
        reason = self._check_samples(place.entry, place.end)
        return reason or self._check_load(place.begin, place.end)

    def _zero_before(self, item: TrackedItem, time: float, entry: int) -> Zero:
        """Return the zero at the `time` of an item, s, after the empty belt in front of it."""
        empty, settled = self._empty_belt(item, entry)
        if settled:
            self._zero.try_to_set((entry - len(empty), entry), self._parameters.zero_moment)
        return self._zero.update(time, empty, settled)

    def _make_window(self, item: TrackedItem, place: _Place, zero: Zero) -> WeighWindow:
        """Return the window of an item whose samples are sound, unless its load is not steady."""
        buffer, cell = self._buffer, self._load_cell
        entry, begin, end = place.entry, place.begin, place.end
        first = buffer.whole_from(entry - self._lead, entry)
        alone_from = min(max(self._alone_from(item, first, begin, place.shift), first), begin)
        before = buffer.look_at(min(alone_from, entry), entry)
        if not self._load_check.is_steady(buffer.look_at(begin, end), before, zero.counts):
            return self._fault(item, Reason.DISTANCE_FAULT)
        # By that of t2: what the clock of the samples is off would show in the lead time.
        lead = round((begin - first) * NANOSECONDS / cell.sample_rate)
        return WeighWindow(
            *self._identity(item),
            sample_rate=cell.sample_rate,
            counts_per_kg=cell.counts_per_kg,
            zero_counts=cell.zero_counts,
            zero=zero.counts,
            zero_std_dev=self._zero_std_dev(item, begin, end, zero, place.doubt),
            first_index=first,
            stamp=buffer.stamp_at(begin) - place.shift - lead,
            empty_begin=alone_from - first,
            window_begin=begin - first,
            window_end=end - first,
            counts=buffer.read(first, self._sound_end(end, place.trail_end)),
        )

    def _fault(self, item: TrackedItem, *reasons: Reason) -> WeighWindow:
        return WeighWindow(*self._identity(item), reasons=tuple(reason.value for reason in reasons))

    def _identity(self, item: TrackedItem) -> _Identity:
        """Return the first fields of the window of an item: which it is, and how it moves."""
        speed, length = self.motion.measure(item)
        line_speed = speed
        if math.isnan(speed) and item.usual_transit is not None:
            line_speed = self._load_cell.weigh_length / seconds(item.usual_transit)
        return item.item_id, item.t1, item.t2, item.t3, speed, length, line_speed

    def _trail_end(self, left: int, end: int) -> int:
        """Return the end of the samples to wait for: no later than the item has `left`, ns."""
        if not self._trail:
            return end
        return max(min(end + self._trail, self._buffer.index_at(left)), end)

    def _sound_end(self, end: int, trail_end: int) -> int:
        """Return the end of what can be used after t3: none of it if any is lost or saturated."""
        trail_end = min(trail_end, self._buffer.end)
        return end if trail_end == end or self._check_samples(end, trail_end) else trail_end

    def _find_shift(self, item: TrackedItem, entry: int, begin: int, end: int) -> int | Reason:
        """Return by how much the window of an item is later than by its edges, ns.

        Or why rise and edges do not agree. The samples are those from t1, t2 and t3 on.
        """
        buffer = self._buffer
        span, count = seconds(buffer.stamp_at(end - 1) - buffer.stamp_at(entry)), end - 1 - entry
        step = span - count / self._load_cell.sample_rate
        if abs(step) > self._parameters.rise_lag_tolerance:
            return Reason.CLOCK_JUMP
        seen = self._see_rise(item, entry, begin, end)
        begins_late = seconds(item.entered - (buffer.origin or 0)) < _BEFORE_RISE
        if self.jumped and begins_late and not seen.is_known:
            return Reason.CLOCK_JUMP  # whether the eyes jumped as well is not to be seen
        shift = self.edge_check.check(seen, *self.motion.measure(item))
        if shift is not None:
            return round(NANOSECONDS * shift)
        # What comes late is the item's own rise: without it the load shows whether it was alone.
        late = round(seen.lag * self._load_cell.sample_rate) if seen.is_known else 0
        window = buffer.look_at(min(begin + max(late, 0), end), end)
        alone = self._load_check.is_steady(window, window[:0], self._zero.zero.counts)
        return Reason.EDGE_MISMATCH if alone else Reason.DISTANCE_FAULT

    def _see_rise(self, item: TrackedItem, entry: int, begin: int, end: int) -> RiseLag:
        """Return the lag of the rise in the samples before t3; not known if others were there."""
        if item.t1 is None or item.t2 is None or item.t3 is None:
            return RiseLag()
        buffer, cell = self._buffer, self._load_cell
        earliest = buffer.whole_from(entry - round(_BEFORE_RISE * cell.sample_rate), entry)
        first = max(self._alone_from(item, earliest, begin), earliest)
        if first >= entry:
            return RiseLag()
        time = np.arange(first - begin, end - begin) / cell.sample_rate
        time += seconds(buffer.stamp_at(begin) - item.t1)
        force = buffer.look_at(first, end) / cell.counts_per_kg
        return rise_lag(force, time, seconds(item.t2 - item.t1), seconds(item.t3 - item.t1))

    def _zero_std_dev(
        self, item: TrackedItem, begin: int, end: int, zero: Zero, doubt: float
    ) -> float:
        """Return how uncertain the zero is, counts, with what an uncertain shift, s, does to it.

        A load that is taken out of the signal too early or late by the time d leaves its area, M d,
        which smoothing spreads over about twice the transit.
        """
        if not doubt or item.t1 is None or item.t3 is None:
            return zero.std_dev
        load = float(np.mean(self._buffer.look_at(begin, end))) - zero.counts
        return math.hypot(zero.std_dev, load * doubt / (2 * seconds(item.t3 - item.t1)))

    def _alone_from(self, item: TrackedItem, first: int, begin: int, shift: int = 0) -> int:
        """Return the index from which on the item before had left, `first` if there was none."""
        if item.left_before is None:
            return begin if item.others_there else first
        return self._buffer.index_at(item.left_before + shift)

    def _check_start(self, item: TrackedItem) -> None:
        """Fault an item that was there before the samples began: its edges are not its own."""
        origin = self._buffer.origin
        margin = self._debounce if item.t1 is not None else self._max_transit
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

    def _check_load(self, begin: int, end: int) -> Reason | None:
        """Compare the mean load, from the zero of calibration on, with the capacity."""
        cell = self._load_cell
        reading = np.add.reduce(self._buffer.look_at(begin, end), dtype=np.int64) / (end - begin)
        load = (float(reading) - cell.zero_counts) / cell.counts_per_kg
        return Reason.OVERLOAD if abs(load) > cell.capacity else None

    def _empty_belt(self, item: TrackedItem, entry: int) -> tuple[NDArray[np.int32], bool]:
        """Return the samples of the empty belt before an item enters, and whether they settled."""
        buffer = self._buffer
        if item.others_there:
            return buffer.look_at(entry, entry), False
        begin = earliest = entry - self._zero_span
        if item.left_before is not None:
            begin = max(begin, buffer.index_at(item.left_before + self._settle_time))
            earliest = max(earliest, buffer.index_at(item.left_before))
        begin = min(buffer.whole_from(begin, entry), entry)
        least = self._parameters.zero_moment * self._load_cell.sample_rate
        if entry - begin < least:
            earliest = min(buffer.whole_from(earliest, entry), entry)
            if least <= entry - earliest:
                return buffer.look_at(earliest, entry), False
        return buffer.look_at(begin, entry), True

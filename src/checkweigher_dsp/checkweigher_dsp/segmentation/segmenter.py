"""Cutting the stream of samples into one weigh window for each item."""

from collections.abc import Iterator
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.items.edge_queue import EdgeQueue
from checkweigher_dsp.items.item import Item
from checkweigher_dsp.items.tracking import ItemTracker
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import (
    NANOSECONDS,
    EyeEdge,
    LoadCell,
    SampleBlock,
    WeighWindow,
    seconds,
)
from checkweigher_dsp.segmentation.load_check import LoadCheck
from checkweigher_dsp.segmentation.motion_check import MotionCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_setting import ZeroAnswer, ZeroSetting
from checkweigher_dsp.segmentation.zero_tracking import Zero, ZeroLimits, ZeroTracker

__all__ = ['Segmenter', 'SegmenterParameters']

_LONGEST_PIECE = NANOSECONDS  # of a block that is taken at once, ns
_Identity = tuple[int, int | None, int | None, int | None, float, float, float]


class Segmenter:
    """Turn samples and photo-eye edges into weigh windows.

    Everything is decided on sample indices and stamps: blocks of any size and any interleaving of
    samples and edges give the same windows, as long as edges are no more than ``edge_lateness``
    behind the samples.

    Parameters
    ----------
    load_cell : LoadCell
        Calibration, rate and the distance between the eyes.
    parameters : SegmenterParameters
        How items are told apart.
    item_count : int
        Items that were there before: the next one is ``item_count + 1``.

    Attributes
    ----------
    samples, edges : int
        Taken so far, those included that came twice.
    items : int
        Windows returned so far.
    zero_answer : ZeroAnswer or None
        What became of the last `request_zero`; None while it waits for the empty belt.
    """

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters, item_count: int = 0
    ) -> None:
        self.load_cell = load_cell
        self._parameters = parameters
        self._max_transit = round(NANOSECONDS * load_cell.weigh_length / parameters.min_belt_speed)
        self._debounce = round(NANOSECONDS * parameters.debounce_time)
        known = parameters.product_length > 0
        self._tracker = ItemTracker(
            self._debounce,
            self._max_transit,
            item_count,
            load_cell.weigh_length / parameters.product_length if known else 0.0,
        )
        self._motion = MotionCheck(load_cell.weigh_length, parameters)
        self._load_check = LoadCheck()
        sensitivity = abs(load_cell.counts_per_kg)
        self._zero_tracker = ZeroTracker(
            load_cell.zero_counts,
            sensitivity * parameters.zero_initial_std_dev,
            sensitivity * parameters.zero_random_walk,
            load_cell.sample_rate,
            ZeroLimits(
                sensitivity * parameters.zero_range,
                sensitivity * parameters.zero_rate,
                sensitivity * parameters.zero_stability,
            ),
        )
        self._lateness = round(NANOSECONDS * parameters.edge_lateness)
        self._sample_lateness = round(NANOSECONDS * parameters.sample_lateness)
        self._settle_time = round(NANOSECONDS * parameters.settle_time)
        rate = load_cell.sample_rate
        self._late = round(parameters.edge_lateness * rate)  # samples, as those that follow
        self._zero_span = round(parameters.zero_time * rate)
        self._lead = round(parameters.lead_time * rate)
        self._trail = round(parameters.trail_time * rate)
        self._buffer = self._new_buffer()
        self._pending = EdgeQueue(self._lateness)
        self._waiting: list[Item] = []
        self._zero_setting: ZeroSetting | None = None
        self.zero_answer: ZeroAnswer | None = None
        self.samples = 0
        self.edges = 0
        self.items = 0

    def _new_buffer(self) -> SampleBuffer:
        known = self._parameters
        # An item takes no longer to leave than from eye to eye.
        trail = min(round(NANOSECONDS * known.trail_time), self._max_transit)
        history = max(known.lead_time, known.zero_time) + seconds(
            self._max_transit + trail + max(2 * self._lateness, _LONGEST_PIECE)
        )
        return SampleBuffer(self.load_cell.sample_rate, history)

    def add_samples(self, block: SampleBlock) -> list[WeighWindow]:
        """Take a block of samples and return the windows that it completes."""
        windows = self._begin_anew(block)
        self._pending.admit_strays()
        self.samples += len(block.counts)
        for piece in self._pieces(block):
            self._buffer.append(piece)
            self._tracker.begin(self._buffer.origin)
            self._take_due_edges()
            now = self._buffer.last_stamp
            if now is not None:
                self._take(self._tracker.expire(now - self._lateness))
            windows += self._cut_waiting()
            self._zero_idle_belt()
        return windows

    def request_zero(self) -> None:
        """Zero on the next empty belt at rest, before an item or when none comes."""
        begin = 0 if self._buffer.empty else self._buffer.end
        self._zero_setting = ZeroSetting(self.load_cell, self._parameters, begin)
        self.zero_answer = None

    def _zero_idle_belt(self) -> None:
        """Zero, if that was asked for and no edge can come any more of the time that is read."""
        if self._zero_setting is None or self._buffer.empty:
            return
        empty = None
        if self._tracker.is_empty:
            empty = (self._settled_from(self._buffer.start), self._buffer.end - self._late)
        self._try_zero(empty, self._parameters.zero_time)

    def _try_zero(self, empty: tuple[int, int] | None, least: float) -> None:
        if self._zero_setting is None:
            return
        self.zero_answer = self._zero_setting.try_at(self._zero_tracker, self._buffer, empty, least)
        if self.zero_answer is not None:
            self._zero_setting = None

    def _begin_anew(self, block: SampleBlock) -> list[WeighWindow]:
        """Begin with a new buffer where the source or its clock does; return what that costs."""
        if len(block.counts) == 0 or self._buffer.empty:
            return []
        late = block.stamp - self._buffer.stamp_at(block.first_index)
        if self._buffer.is_restart(block):
            reason = Reason.SOURCE_RESTARTED
        elif abs(late) > NANOSECONDS * self._parameters.clock_tolerance:
            reason = Reason.CLOCK_JUMP
        else:
            return []
        last = self._buffer.last_stamp
        forward = last is not None and block.stamp > last
        later = self._pending.pop_of_new_clock(block.stamp, forward=forward)
        windows = self.give_up(reason)
        self._pending.put_back(later)
        self._tracker.forget(backwards=not forward)
        if reason is Reason.SOURCE_RESTARTED:  # a clock that jumps leaves the belt its speed
            self._motion.forget()
        self._buffer = self._new_buffer()
        if self._zero_setting is not None:
            self.request_zero()
        return windows

    def _pieces(self, block: SampleBlock) -> Iterator[SampleBlock]:
        """Cut a block so that no part of it leaves the buffer before it was looked at."""
        rate = self.load_cell.sample_rate
        size = max(1, int(rate * seconds(_LONGEST_PIECE)))
        if 0 < len(block.counts) <= size:
            yield block
            return
        for begin in range(0, len(block.counts), size):
            yield SampleBlock(
                block.stamp + round(begin * NANOSECONDS / rate),
                block.first_index + begin,
                block.counts[begin : begin + size],
            )

    def add_edge(self, edge: EyeEdge) -> list[WeighWindow]:
        """Take a photo-eye edge and return the windows that it completes."""
        self.edges += 1
        self._pending.add(edge)
        self._take_due_edges()
        return self._give_up_without_samples(edge.stamp) + self._cut_waiting()

    def _take_due_edges(self) -> None:
        """Hand edges on as the samples reach them."""
        buffer = self._buffer
        if not buffer.empty:
            end = buffer.end
            for edge in self._pending.pop_while(lambda e: buffer.index_at(e.stamp) <= end):
                self._take(self._tracker.add(edge))

    def _give_up_without_samples(self, stamp: int) -> list[WeighWindow]:
        """Return what has waited too long for its samples when an edge of `stamp` has come."""
        limit = stamp - self._sample_lateness
        for edge in self._pending.pop_while(lambda edge: edge.stamp < limit):
            self._take(self._tracker.add(edge))
        late = [item for item in self._waiting if item.entered < limit]
        for item in late:
            item.fault(Reason.SAMPLES_LOST)
        return self._cut_waiting(wait=False) if late else []

    def _take(self, items: list[Item]) -> None:
        """Let items wait for their samples; what comes later of them does not change them."""
        for item in items:
            waiting = item.snapshot()
            self._check_start(waiting)
            self._motion.check(waiting)
            self._waiting.append(waiting)

    @property
    def zero(self) -> Zero:
        """The zero as it stands."""
        return self._zero_tracker.zero

    def idle_belt(self) -> NDArray[np.int32]:
        """Return the last samples of a belt that surely is empty and settled, (n,); none if not."""
        nothing = np.zeros(0, np.int32)
        if self._buffer.empty or not self._tracker.is_empty:
            return nothing
        end = self._buffer.end - self._late
        begin = self._settled_from(max(self._buffer.start, end - self._zero_span))
        whole = begin < end and self._buffer.is_whole(begin, end)
        return self._buffer.read(begin, end) if whole else nothing

    def _settled_from(self, begin: int) -> int:
        """Return the index from which on, not before `begin`, the empty belt has settled."""
        left = self._tracker.empty_since
        return (
            begin if left is None else max(begin, self._buffer.index_at(left + self._settle_time))
        )

    def finish(self) -> list[WeighWindow]:
        """Return what is still on the belt, as faults: the stream has ended."""
        return self.give_up(Reason.STREAM_ENDED)

    @property
    def item_count(self) -> int:
        """Number of the last item that entered."""
        return self._tracker.count

    def give_up(self, reason: Reason) -> list[WeighWindow]:
        """Return what is still on the belt, as faults with `reason`."""
        for edge in self._pending.pop_all():
            self._take(self._tracker.add(edge))
        windows = self._cut_waiting(wait=False)
        for item in self._waiting:
            item.fault(reason)
        self._take(self._tracker.give_up(reason))
        return windows + self._cut_waiting(wait=False)

    def _cut_waiting(self, *, wait: bool = True) -> list[WeighWindow]:
        if not self._waiting:
            return []
        windows, still_waiting = [], []
        for item in self._waiting:
            window = self._cut(item, wait=wait)
            if window is None:
                still_waiting.append(item)
            else:
                windows.append(window)
        self._waiting = still_waiting
        self.items += len(windows)
        return windows

    def _cut(self, item: Item, *, wait: bool) -> WeighWindow | None:
        """Return the window of an item, None while its samples are yet to come.

        Without `wait` only those up to t3 must be there.
        """
        if self._buffer.empty and wait:
            return None
        self._check_start(item)
        if item.faults or item.t1 is None or item.t2 is None or item.t3 is None:
            return self._fault(item, *item.faults)
        if self._buffer.empty:
            return None
        entry, begin, end = (self._buffer.index_at(t) for t in (item.t1, item.t2, item.t3))
        trail_end = self._trail_end(item, end)
        if self._buffer.end < (trail_end if wait else end):
            return None
        if end - begin < self._parameters.min_window:
            return self._fault(item, Reason.WINDOW_TOO_SHORT)
        reason = self._check_samples(entry, end)
        if reason is not None:
            return self._fault(item, reason)
        first = self._buffer.whole_from(entry - self._lead, entry)
        stretch, settled = self._empty_belt(item, entry)
        if settled:
            self._try_zero((entry - len(stretch), entry), self._parameters.zero_moment)
        zero = self._zero_tracker.update(seconds(item.t1), stretch, settled)
        if not zero.trusted:
            return self._fault(item, Reason.ZERO_OUT_OF_RANGE)
        alone_from = min(max(self._alone_from(item, first, begin), first), begin)
        window = self._buffer.look_at(begin, end)
        empty = self._buffer.look_at(min(alone_from, entry), entry)
        if not self._load_check.is_steady(window, empty, zero.counts):
            return self._fault(item, Reason.DISTANCE_FAULT)
        cell = self.load_cell
        return WeighWindow(
            *self._identity(item),
            sample_rate=cell.sample_rate,
            counts_per_kg=cell.counts_per_kg,
            zero_counts=cell.zero_counts,
            zero=zero.counts,
            zero_std_dev=zero.std_dev,
            first_index=first,
            # By that of t2: what the clock of the samples is off would show in the lead time.
            stamp=self._buffer.stamp_at(begin)
            - round((begin - first) * NANOSECONDS / cell.sample_rate),
            empty_begin=alone_from - first,
            window_begin=begin - first,
            window_end=end - first,
            counts=self._buffer.read(first, self._sound_end(end, trail_end)),
        )

    def _fault(self, item: Item, *reasons: Reason) -> WeighWindow:
        return WeighWindow(*self._identity(item), reasons=tuple(reason.value for reason in reasons))

    def _identity(self, item: Item) -> _Identity:
        """Return the first fields of the window of an item: which it is, and how it moves."""
        speed, length = self._motion.measure(item)
        line_speed = self._line_speed(item, speed)
        return item.item_id, item.t1, item.t2, item.t3, speed, length, line_speed

    def _trail_end(self, item: Item, end: int) -> int:
        """Return the end of the samples to wait for: no later than the item has left."""
        if not self._trail or item.t1 is None or item.t2 is None or item.t3 is None:
            return end
        return max(min(end + self._trail, self._buffer.index_at(item.t3 + item.t2 - item.t1)), end)

    def _sound_end(self, end: int, trail_end: int) -> int:
        """Return the end of what can be used after t3: none of it if any is lost or saturated."""
        trail_end = min(trail_end, self._buffer.end)
        return end if trail_end == end or self._check_samples(end, trail_end) else trail_end

    def _alone_from(self, item: Item, first: int, begin: int) -> int:
        """Return the index from which on the item before had left, `first` if there was none."""
        if item.left_before is None:
            return begin if item.others_there else first
        return self._buffer.index_at(item.left_before)

    def _line_speed(self, item: Item, speed: float) -> float:
        """Return the speed by which to time the rejector, m/s."""
        if math.isnan(speed) and item.usual_transit is not None:
            return self.load_cell.weigh_length / seconds(item.usual_transit)
        return speed

    def _check_start(self, item: Item) -> None:
        """Note if the item was there before the samples began: its edges are not the true ones."""
        origin = self._buffer.origin
        if origin is None:
            return
        if item.t1 is not None:
            before = item.t1 <= origin + self._debounce
        else:
            before = item.entered <= origin + self._max_transit
        if before:
            item.fault(Reason.START_UP)

    def _check_samples(self, begin: int, end: int) -> Reason | None:
        if not self._buffer.is_whole(begin, end):
            return Reason.SAMPLES_LOST
        counts, limits = self._buffer.look_at(begin, end), self.load_cell
        if len(counts) and (
            int(np.minimum.reduce(counts)) <= limits.min_counts
            or int(np.maximum.reduce(counts)) >= limits.max_counts
        ):
            return Reason.SATURATION
        return None

    def _empty_belt(self, item: Item, entry: int) -> tuple[NDArray[np.int32], bool]:
        """Return the samples of the empty belt before an item enters, and whether they settled."""
        buffer = self._buffer
        if item.others_there:
            return buffer.look_at(entry, entry), False
        begin = earliest = entry - self._zero_span
        if item.left_before is not None:
            begin = max(begin, buffer.index_at(item.left_before + self._settle_time))
            earliest = max(earliest, buffer.index_at(item.left_before))
        begin = min(buffer.whole_from(begin, entry), entry)
        least = self._parameters.zero_moment * self.load_cell.sample_rate
        if entry - begin < least:
            earliest = min(buffer.whole_from(earliest, entry), entry)
            if least <= entry - earliest:
                return buffer.look_at(earliest, entry), False
        return buffer.look_at(begin, entry), True

"""Cutting the stream of samples into one weigh window for each item."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.item_tracking import Item, ItemTracker
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.records import (
    NANOSECONDS,
    EyeEdge,
    LoadCell,
    Reason,
    SampleBlock,
    WeighWindow,
    seconds,
)
from checkweigher_dsp.sample_buffer import SampleBuffer
from checkweigher_dsp.zero_tracking import ZeroTracker

_LONGEST_PIECE = NANOSECONDS  # of a block that is taken at once, ns


@dataclass(frozen=True)
class SegmenterParameters(Parameters):
    """How items are told apart and what counts as the empty belt."""

    node: ClassVar[str] = 'segmenter'

    lead_time: float = parameter(
        0.5, 'signal before t1 that goes with each window', unit='s', minimum=0, maximum=60
    )
    trail_time: float = parameter(
        0.0, 'signal after t3 that is waited for, at most until the item has left', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    zero_time: float = parameter(
        1.0, 'empty belt before t1 that is read for the zero, at most', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    settle_time: float = parameter(
        0.1, 'ring-down after an item has left, not read for the zero', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    zero_initial_std_dev: float = parameter(
        0.005, 'how far the zero may have drifted since calibration', unit='kg',
        minimum=1e-9, maximum=1e6,
    )  # fmt: skip
    zero_random_walk: float = parameter(
        1e-5, 'drift of the zero, standard deviation after one second', unit='kg/sqrt(s)',
        minimum=0, maximum=1e6,
    )  # fmt: skip
    min_belt_speed: float = parameter(
        0.1, 'slowest belt; an item that takes longer is given up', unit='m/s',
        minimum=1e-3, maximum=100,
    )  # fmt: skip
    max_belt_speed: float = parameter(
        3.0, 'fastest belt', unit='m/s', minimum=1e-3, maximum=100
    )  # fmt: skip
    min_product_length: float = parameter(
        0.005, 'anything shorter is no product', unit='m', minimum=0, maximum=100
    )
    debounce_time: float = parameter(
        0.005, 'an eye that clears for less has chattered', unit='s', minimum=0, maximum=10
    )
    edge_lateness: float = parameter(
        2.0, 'how far edges may arrive behind the samples of the same time', unit='s',
        minimum=0, maximum=60,
    )  # fmt: skip
    min_window: int = parameter(
        16, 'fewest samples between t2 and t3 that can be weighed', unit='samples',
        minimum=8, maximum=1_000_000,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_belt_speed >= self.max_belt_speed:
            raise ParameterError(
                f'segmenter.min_belt_speed: {self.min_belt_speed:g} is not below max_belt_speed '
                f'{self.max_belt_speed:g} m/s'
            )


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
    """

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters, item_count: int = 0
    ) -> None:
        self.load_cell = load_cell
        self._parameters = parameters
        self._max_transit = round(NANOSECONDS * load_cell.weigh_length / parameters.min_belt_speed)
        self._tracker = ItemTracker(
            round(NANOSECONDS * parameters.debounce_time), self._max_transit, item_count
        )
        sensitivity = abs(load_cell.counts_per_kg)
        self._zero_tracker = ZeroTracker(
            load_cell.zero_counts,
            sensitivity * parameters.zero_initial_std_dev,
            sensitivity * parameters.zero_random_walk,
            load_cell.sample_rate,
        )
        self._lateness = round(NANOSECONDS * parameters.edge_lateness)
        self._buffer = self._new_buffer()
        self._waiting: list[Item] = []
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
        windows = []
        if self._buffer.is_restart(block):
            windows = self.give_up(Reason.SOURCE_RESTARTED)
            self._buffer = self._new_buffer()
        self.samples += len(block.counts)
        for piece in self._pieces(block):
            self._buffer.append(piece)
            now = self._buffer.last_stamp
            if now is not None:
                self._waiting += _copies(self._tracker.expire(now - self._lateness))
            windows += self._cut_waiting()
        return windows

    def _pieces(self, block: SampleBlock) -> Iterator[SampleBlock]:
        """Cut a block so that no part of it leaves the buffer before it was looked at."""
        rate = self.load_cell.sample_rate
        size = max(1, int(rate * seconds(_LONGEST_PIECE)))
        for begin in range(0, len(block.counts), size):
            yield SampleBlock(
                block.stamp + round(begin * NANOSECONDS / rate),
                block.first_index + begin,
                block.counts[begin : begin + size],
            )

    def add_edge(self, edge: EyeEdge) -> list[WeighWindow]:
        """Take a photo-eye edge and return the windows that it completes."""
        self.edges += 1
        self._waiting += _copies(self._tracker.add(edge))
        return self._cut_waiting()

    def finish(self) -> list[WeighWindow]:
        """Return what is still on the belt, as faults: the stream has ended."""
        return self.give_up(Reason.STREAM_ENDED)

    @property
    def item_count(self) -> int:
        """Number of the last item that entered."""
        return self._tracker.count

    def give_up(self, reason: Reason) -> list[WeighWindow]:
        """Return what is still on the belt, as faults with `reason`."""
        windows = self._cut_waiting(wait=False)
        for item in self._waiting:
            item.fault(reason)
        self._waiting += _copies(self._tracker.give_up(reason))
        return windows + self._cut_waiting()

    def _cut_waiting(self, *, wait: bool = True) -> list[WeighWindow]:
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
        speed, length = self._motion(item)
        self._check_motion(item, speed, length)
        fault = WeighWindow(
            item.item_id, item.t1, item.t2, item.t3, speed, length, self._line_speed(item, speed),
            reasons=tuple(reason.value for reason in item.faults),
        )  # fmt: skip
        if item.faults or item.t1 is None or item.t2 is None or item.t3 is None:
            return fault
        if self._buffer.empty:
            return None
        entry, begin, end = (self._buffer.index_at(t) for t in (item.t1, item.t2, item.t3))
        trail_end = self._trail_end(item, end)
        if self._buffer.end < (trail_end if wait else end):
            return None
        if end - begin < self._parameters.min_window:
            return replace(fault, reasons=(Reason.WINDOW_TOO_SHORT.value,))
        reason = self._check_samples(entry, end)
        if reason is not None:
            return replace(fault, reasons=(reason.value,))
        lead = round(self._parameters.lead_time * self.load_cell.sample_rate)
        first = self._buffer.whole_from(entry - lead, entry)
        zero = self._zero_tracker.update(seconds(item.t1), self._empty_belt(item, entry))
        return replace(
            fault,
            sample_rate=self.load_cell.sample_rate,
            counts_per_kg=self.load_cell.counts_per_kg,
            zero_counts=self.load_cell.zero_counts,
            zero=zero.counts,
            zero_std_dev=zero.std_dev,
            first_index=first,
            stamp=self._buffer.stamp_at(first),
            empty_begin=min(max(self._empty_from(item, first) - first, 0), entry - first),
            window_begin=begin - first,
            window_end=end - first,
            counts=self._buffer.read(first, self._sound_end(end, trail_end)),
        )

    def _trail_end(self, item: Item, end: int) -> int:
        """Return the end of the samples to wait for: no later than the item has left."""
        trail = round(self._parameters.trail_time * self.load_cell.sample_rate)
        if not trail or item.t1 is None or item.t2 is None or item.t3 is None:
            return end
        return max(min(end + trail, self._buffer.index_at(item.t3 + item.t2 - item.t1)), end)

    def _sound_end(self, end: int, trail_end: int) -> int:
        """Return the end of what can be used after t3: none of it if any is lost or saturated."""
        trail_end = min(trail_end, self._buffer.end)
        return end if self._check_samples(end, trail_end) else trail_end

    def _empty_from(self, item: Item, first: int) -> int:
        """Return the index from which on the item before had left, `first` if none is known."""
        return first if item.left_before is None else self._buffer.index_at(item.left_before)

    def _motion(self, item: Item) -> tuple[float, float]:
        """Return belt speed in m/s and product length in m, NaN where an edge is missing."""
        if item.t1 is None or item.t3 is None or item.t3 <= item.t1:
            return math.nan, math.nan
        speed = self.load_cell.weigh_length / seconds(item.t3 - item.t1)
        if item.t2 is None:
            return speed, math.nan
        return speed, speed * seconds(item.t2 - item.t1)

    def _line_speed(self, item: Item, speed: float) -> float:
        """Return the speed by which to time the rejector, m/s."""
        if math.isnan(speed) and item.usual_transit is not None:
            return self.load_cell.weigh_length / seconds(item.usual_transit)
        return speed

    def _check_motion(self, item: Item, speed: float, length: float) -> None:
        limits = self._parameters
        if item.t3 is not None and item.t1 is not None and item.t3 <= item.t1:
            item.fault(Reason.BELT_SPEED)
        if speed < limits.min_belt_speed or speed > limits.max_belt_speed:
            item.fault(Reason.BELT_SPEED)
        if length < limits.min_product_length:
            item.fault(Reason.PRODUCT_TOO_SHORT)
        if length >= self.load_cell.weigh_length:
            item.fault(Reason.PRODUCT_TOO_LONG)

    def _check_samples(self, begin: int, end: int) -> Reason | None:
        if not self._buffer.is_whole(begin, end):
            return Reason.SAMPLES_LOST
        counts = self._buffer.read(begin, end)
        limits = self.load_cell
        if np.any((counts <= limits.min_counts) | (counts >= limits.max_counts)):
            return Reason.SATURATION
        return None

    def _empty_belt(self, item: Item, entry: int) -> NDArray[np.int32]:
        """Return the samples of the empty belt before an item enters."""
        rate = self.load_cell.sample_rate
        begin = entry - round(self._parameters.zero_time * rate)
        if item.left_before is not None:
            settled = item.left_before + round(NANOSECONDS * self._parameters.settle_time)
            begin = max(begin, self._buffer.index_at(settled))
        begin = min(self._buffer.whole_from(begin, entry), entry)
        return self._buffer.read(begin, entry)


def _copies(items: list[Item]) -> list[Item]:
    """Detach items from the tracker: edges that come later do not change them any more."""
    return [replace(item, faults=dict(item.faults)) for item in items]

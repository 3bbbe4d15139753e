# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cutting the stream of samples into one weigh window for each item."""

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import (
    NANOSECONDS,
    EyeEdge,
    Item,
    LoadCell,
    SampleBlock,
    WeighWindow,
    seconds,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.item_source import ItemSource
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.window_cutter import WindowCutter
from checkweigher_dsp.segmentation.zero_keeper import Span, ZeroAnswer, ZeroKeeper
from checkweigher_dsp.segmentation.zero_tracking import Zero

_LONGEST_PIECE = NANOSECONDS  # of a block that is taken at once, ns


class Segmenter:
    """Turn samples and photo-eye edges into weigh windows.

    Everything is decided on sample indices and stamps: blocks of any size and any interleaving of
    samples and edges give the same windows, if edges are no more than ``edge_lateness`` behind the
    samples.

    Parameters
    ----------
    load_cell : LoadCell
        Calibration, rate and the distance between the eyes.
    parameters : SegmenterParameters
        How items are told apart.
    item_count : int
        Items that were there before: the next one is ``item_count + 1``.

    Raises
    ------
    ParameterError
        If the load cell and the parameters ask for windows that are too long.

    Attributes
    ----------
    samples, edges : int
        Taken so far, those included that came twice.
    """

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters, item_count: int = 0
    ) -> None:
        parameters.check_lengths(load_cell)
        self.load_cell = load_cell
        self._parameters = parameters
        rate = load_cell.sample_rate
        self._sample_lateness = round(NANOSECONDS * parameters.sample_lateness)
        self._settle_time = round(NANOSECONDS * parameters.settle_time)
        self._late = round(parameters.edge_lateness * rate)  # samples, as those that follow
        self._zero_span = round(parameters.zero_time * rate)
        self._longest_piece = max(1, int(rate * seconds(_LONGEST_PIECE)))
        self._buffer = SampleBuffer(rate, _history(load_cell, parameters))
        self._zero = ZeroKeeper(load_cell, parameters, self._buffer)
        self._source = ItemSource(load_cell, parameters, self._buffer, self._zero, item_count)
        self._cutter = WindowCutter(load_cell, parameters, self._buffer, self._zero)
        self.samples = 0
        self.edges = 0

    @property
    def zero(self) -> Zero:
        """The zero as it stands."""
        return self._zero.zero

    @property
    def zero_answer(self) -> ZeroAnswer | None:
        """Answer to the last `request_zero`; None while it waits for the empty belt."""
        return self._zero.answer

    @property
    def edge_check(self) -> EdgeCheck:
        """How rise and edges of the items agree."""
        return self._cutter.edge_check

    @property
    def items(self) -> int:
        """Windows returned so far."""
        return self._cutter.count

    @property
    def item_count(self) -> int:
        """Number of the last item that entered."""
        return self._source.tracker.count

    def take_announced(self) -> list[Item]:
        """Return the announcements of items since the last call: before the windows of these."""
        return self._source.take_announced()

    @property
    def last_edge(self) -> int | None:
        """Stamp of the youngest edge that the announcements rest on, ns; None if there is none."""
        return self._source.tracker.newest

    @property
    def edges_wait(self) -> bool:
        """Whether edges wait for their samples."""
        return self._source.edges_wait

    def go_by_edges(self) -> list[WeighWindow]:
        """Find the items of edges that wait for samples; return the windows that it completes."""
        self._cutter.take(self._source.track_waiting())
        return self._cutter.cut()

    def take(self, record: SampleBlock | EyeEdge) -> list[WeighWindow]:
        """Take a block of samples or an edge and return the windows that it completes."""
        if isinstance(record, SampleBlock):
            return self.add_samples(record)
        return self.add_edge(record)

    def add_samples(self, block: SampleBlock) -> list[WeighWindow]:
        """Take a block of samples and return the windows that it completes."""
        windows = self._restart_if_new(block)
        self.samples += len(block.counts)
        for piece in self._pieces(block):
            self._buffer.append(piece)
            self._cutter.take(self._source.advance())
            windows += self._cutter.cut()
            if self._zero.is_requested:
                # No edge of the time that is read can come any more.
                self._zero.try_to_set(self._empty_span(), self._parameters.zero_time)
        return windows

    def add_edge(self, edge: EyeEdge) -> list[WeighWindow]:
        """Take a photo-eye edge and return the windows that it completes."""
        self.edges += 1
        self._cutter.take(self._source.add(edge))
        return self._give_up_without_samples(edge.stamp) + self._cutter.cut()

    def request_zero(self) -> None:
        """Zero on the next empty belt at rest, before an item or when none comes."""
        self._zero.request()

    def idle_belt(self) -> NDArray[np.int32]:
        """Return the last samples of a belt that surely is empty and settled, (n,); none if not."""
        begin, end = self._empty_span() or (0, 0)
        begin = max(begin, end - self._zero_span)
        whole = begin < end and self._buffer.is_whole(begin, end)
        return self._buffer.read(begin, end) if whole else np.zeros(0, np.int32)

    def finish(self) -> list[WeighWindow]:
        """Return what is still on the belt, as faults: the stream has ended."""
        return self.give_up(Reason.STREAM_ENDED)

    def give_up(self, reason: Reason) -> list[WeighWindow]:
        """Return what is still on the belt, as faults with `reason`."""
        self._cutter.take(self._source.finish_edges())
        windows = self._cutter.cut(wait=False)
        self._cutter.fault_waiting(reason)
        self._cutter.take(self._source.give_up(reason))
        return windows + self._cutter.cut(wait=False)

    def _restart_if_new(self, block: SampleBlock) -> list[WeighWindow]:
        """Empty the buffer where the source or its clock starts again; return what that costs."""
        buffer = self._buffer
        if len(block.counts) == 0 or buffer.empty:
            return []
        late = block.stamp - buffer.stamp_at(block.first_index)
        if buffer.is_restart(block):
            reason = Reason.SOURCE_RESTARTED
        elif abs(late) > NANOSECONDS * self._parameters.clock_tolerance:
            reason = Reason.CLOCK_JUMP
        else:
            return []
        last = buffer.last_stamp
        forward = last is not None and block.stamp > last
        later = self._source.edges_of_new_clock(block.stamp, forward=forward)
        windows = self.give_up(reason)
        self._source.change_clock(later, forward=forward)
        if reason is Reason.SOURCE_RESTARTED:  # a clock that jumps leaves the belt its speed
            self._cutter.motion.forget()
            self._cutter.edge_check.forget()
        buffer.clear()
        self._cutter.jumped = reason is Reason.CLOCK_JUMP
        if self._zero.is_requested:
            self.request_zero()
        return windows

    def _pieces(self, block: SampleBlock) -> list[SampleBlock]:
        """Cut a block so that no part of it leaves the buffer before it was looked at."""
        size = self._longest_piece
        if 0 < len(block.counts) <= size:
            return [block]
        return [
            SampleBlock(
                block.stamp + round(begin * NANOSECONDS / self.load_cell.sample_rate),
                block.first_index + begin,
                block.counts[begin : begin + size],
            )
            for begin in range(0, len(block.counts), size)
        ]

    def _give_up_without_samples(self, stamp: int) -> list[WeighWindow]:
        """Return what has waited too long for its samples when an edge of `stamp` has come."""
        limit = stamp - self._sample_lateness
        self._cutter.take(self._source.give_up_before(limit))
        late = self._cutter.fault_waiting(Reason.SAMPLES_LOST, limit)
        return self._cutter.cut(wait=False) if late else []

    def _empty_span(self) -> Span | None:
        """Return the samples of a belt that surely is empty and settled; None if it is not."""
        buffer = self._buffer
        if buffer.empty or not self._source.tracker.is_empty:
            return None
        begin, left = buffer.start, self._source.tracker.empty_since
        if left is not None:
            begin = max(begin, buffer.index_at(left + self._settle_time))
        return begin, buffer.end - self._late


def _history(load_cell: LoadCell, parameters: SegmenterParameters) -> float:
    """Return how far back samples are read, s."""
    transit = parameters.max_transit(load_cell.weigh_length)
    # An item takes no longer to leave than from eye to eye.
    trail = min(round(NANOSECONDS * parameters.trail_time), transit)
    lateness = round(NANOSECONDS * parameters.edge_lateness)
    behind = transit + trail + max(2 * lateness, _LONGEST_PIECE)
    return max(parameters.lead_time, parameters.zero_time) + seconds(behind)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Segmentation stage, which cuts one weigh window for each item from the stream of samples."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import (
    NANOSECONDS,
    Eye,
    EyeEdge,
    Item,
    LoadCell,
    SampleBlock,
    WeighWindow,
    seconds,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.failures import PRINTED, Failures
from checkweigher_dsp.segmentation.item_source import ItemSource
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.window_cutter import WindowCutter
from checkweigher_dsp.segmentation.zero_keeper import Span, ZeroKeeper

_LONGEST_PIECE = NANOSECONDS  # longest duration in ns of samples that are appended together


class Segmenter:
    """Stage that cuts weigh windows from samples by photo-eye edges.

    All decisions depend only on the indices of samples and on time stamps. So the windows do not
    depend on the size of the blocks, or on the order in which samples and edges arrive. Samples may
    be at most ``sample_lateness`` late, and edges at most ``edge_lateness``.

    Parameters
    ----------
    load_cell : LoadCell
        Calibration, sample rate and distance between the eyes.
    parameters : SegmenterParameters
        Parameters of the stage.
    item_count : int
        Number of the last item before this stream, or 0.
    failures : Failures
        Handler of exceptions that are raised while an item is processed.

    Raises
    ------
    ParameterError
        If the windows need too many samples at the sample rate of the load cell.

    Attributes
    ----------
    samples, edges : int
        Numbers of processed samples and edges, including repeated ones.
    cutter : WindowCutter
        Cutter of the windows.
    zero_keeper : ZeroKeeper
        Zero of the scale, with the requests to set it.
    """

    def __init__(
        self,
        load_cell: LoadCell,
        parameters: SegmenterParameters,
        item_count: int = 0,
        failures: Failures = PRINTED,
    ) -> None:
        parameters.check_lengths(load_cell)
        self.load_cell = load_cell
        self._parameters = parameters
        self._buffer = SampleBuffer(load_cell.sample_rate, _history(load_cell, parameters))
        self.zero_keeper = ZeroKeeper(load_cell, parameters, self._buffer)
        inputs = load_cell, parameters, self._buffer, self.zero_keeper
        self._source = ItemSource(*inputs, item_count)
        self.cutter = WindowCutter(*inputs, failures)
        self.samples = self.edges = 0

    @property
    def item_count(self) -> int:
        """Number of the last item."""
        return self._source.tracker.belt.count

    @property
    def last_edge(self) -> int | None:
        """Largest stamp in ns of the edges since the clock last jumped back, or None."""
        return self._source.tracker.eyes.newest

    @property
    def leaving_since(self) -> int | None:
        """Time in ns since which the outfeed eye is blocked, or None if it is clear.

        If the clock has gone back since the eye was blocked, the time is before any stamp.
        """
        edge = self._source.tracker.eyes.youngest.get(Eye.OUTFEED)
        return edge.stamp if edge is not None and edge.blocked else None

    @property
    def edges_wait(self) -> bool:
        """Whether edges wait for the samples of the same time. Strays are not counted."""
        return not self._source.queue.is_empty

    def take_announced(self) -> list[Item]:
        """Return the announcements since the last call, which must be sent before the windows."""
        return self._source.take_announced()

    def take(self, record: SampleBlock | EyeEdge) -> list[WeighWindow]:
        """Process a block of samples or an edge, and return the completed windows."""
        if isinstance(record, SampleBlock):
            return self._add_samples(record)
        self.edges += 1
        self.cutter.take(self._source.add(record))
        # Items that entered before the limit are faults, because their samples are too late.
        limit = record.stamp - round(NANOSECONDS * self._parameters.sample_lateness)
        self.cutter.take(self._source.track_before(limit))
        late = self.cutter.fault_waiting(Reason.SAMPLES_LOST, limit)
        return (self.cutter.cut(wait=False) if late else []) + self.cutter.cut()

    def go_by_edges(self) -> list[WeighWindow]:
        """Process edges without waiting for samples, and return the completed windows."""
        self.cutter.take(self._source.track_before())
        return self.cutter.cut()

    def idle_belt(self) -> NDArray[np.int32]:
        """Return the last samples of an empty belt without ring-down, (n,) in counts.

        The samples cover at most ``zero_time``. If the belt has not been empty for long enough, or
        if samples were lost, n is 0.
        """
        begin, end = self._empty_span() or (0, 0)
        begin = max(begin, end - round(self._parameters.zero_time * self.load_cell.sample_rate))
        whole = begin < end and self._buffer.is_whole(begin, end)
        return self._buffer.read(begin, end) if whole else np.zeros(0, np.int32)

    def finish(self) -> list[WeighWindow]:
        """End the stream, and return the remaining windows as `give_up` does."""
        return self.give_up(Reason.STREAM_ENDED)

    def give_up(self, reason: Reason) -> list[WeighWindow]:
        """Give up the items on the belt, and return the remaining windows.

        The window of an item that is still on the belt, or whose samples have not arrived, is a
        fault with the given reason.
        """
        self.cutter.take(self._source.finish_edges())
        windows = self.cutter.cut(wait=False)
        self.cutter.fault_waiting(reason)
        self.cutter.take(self._source.give_up(reason))
        return windows + self.cutter.cut(wait=False)

    def _add_samples(self, block: SampleBlock) -> list[WeighWindow]:
        windows = self._restart_if_new(block)
        self.samples += len(block.counts)
        for piece in self._pieces(block):
            self._buffer.append(piece)
            self.cutter.take(self._source.advance())
            windows += self.cutter.cut()
            if self.zero_keeper.is_requested:
                # The span of the empty belt ends `edge_lateness` before the newest sample, because
                # an edge may still arrive that late.
                self.zero_keeper.try_to_set(self._empty_span(), self._parameters.zeroing_time)
        return windows

    def _restart_if_new(self, block: SampleBlock) -> list[WeighWindow]:
        """Begin a new stream if a block shows a restart of the source or a jump of the clock.

        Returns the remaining windows of the previous stream as `give_up` does.
        """
        buffer = self._buffer
        if len(block.counts) == 0 or buffer.empty:
            return []
        late = block.stamp - buffer.stamp_at(block.first_index)
        restarted = buffer.is_restart(block)
        if not restarted and abs(late) <= NANOSECONDS * self._parameters.clock_tolerance:
            return []
        forward = block.stamp > buffer.last_stamp
        later = self._source.queue.pop_of_new_clock(block.stamp, forward=forward)
        windows = self.give_up(Reason.SOURCE_RESTARTED if restarted else Reason.CLOCK_JUMP)
        self._source.queue.put_back(later)
        self._source.tracker.forget(backwards=not forward)
        if restarted:  # A jump of the clock does not change the belt speed.
            self.cutter.motion.forget()
            self.cutter.edge_check.forget()
        buffer.clear()
        self.cutter.jumped = not restarted
        if self.zero_keeper.is_requested:
            self.zero_keeper.request()
        return windows

    def _pieces(self, block: SampleBlock) -> Iterator[SampleBlock]:
        """Yield a block in parts of at most 1 s.

        A longer part could push samples out of the buffer before they are used.
        """
        rate, counts = self.load_cell.sample_rate, block.counts
        size = max(1, int(rate * seconds(_LONGEST_PIECE)))
        for begin in range(0, len(counts), size):
            stamp = block.stamp + round(begin * NANOSECONDS / rate)
            yield SampleBlock(stamp, block.first_index + begin, counts[begin : begin + size])

    def _empty_span(self) -> Span | None:
        """Return the span of samples of the empty belt, or None if the belt is not empty.

        The span contains no ring-down, and no samples for which an edge may still arrive. If the
        belt has not been empty for long enough, the span contains no samples, and its end may be
        before its beginning.
        """
        buffer, tracker = self._buffer, self._source.tracker
        if buffer.empty or not tracker.is_empty:
            return None
        begin, left, parameters = buffer.start, tracker.empty_since, self._parameters
        if left is not None:
            begin = max(begin, buffer.index_at(left + round(NANOSECONDS * parameters.settle_time)))
        return begin, buffer.end - round(parameters.edge_lateness * self.load_cell.sample_rate)


def _history(load_cell: LoadCell, parameters: SegmenterParameters) -> float:
    """Return the duration of the buffer in s."""
    transit = parameters.max_transit(load_cell.weigh_length)
    # An item is not longer than the belt, so it does not need more than a transit to leave.
    trail = min(round(NANOSECONDS * parameters.trail_time), transit)
    late = max(2 * round(NANOSECONDS * parameters.edge_lateness), _LONGEST_PIECE)
    return max(parameters.lead_time, parameters.zeroing_time) + seconds(transit + trail + late)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node segmenter, which converts load_cell/samples and photo_eyes to weigh_window."""

from collections import deque
from dataclasses import replace
from functools import partial
import time
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_core import changes
from checkweigher_core.health.findings import Finding
from checkweigher_core.records import (
    NANOSECONDS,
    NUMBERS_AT_ONCE,
    EyeEdge,
    LoadCell,
    SampleBlock,
    StreamState,
    StreamStatus,
    WeighWindow,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.line_parameters import in_time
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.health.segmenter import SegmenterWatch
from checkweigher_dsp.items.failures import Failures
from checkweigher_dsp.nodes.given_numbers import GivenNumbers, open_numbers
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

_MAX_EARLY = 1_000  # maximum number of blocks and edges that wait for load_cell/info.
# The node sends its status with the samples, not by a timer, because a replay waits for the status.
# In addition, the permission to run the line must expire if no samples arrive.
_STATUS_INTERVAL = 0.2  # duration in s of the signal between two status messages
_STATUS_BLOCKS = 100  # largest number of blocks between two status messages
_ANSWER_PERIOD = 0.01  # interval between two checks of the connections in s
_ZERO_PATIENCE = 15.0  # timeout in s of the service `zero`.
# Time in s without samples after which items are announced by their edges alone.
_STALL_TIME = 0.1
_END_PATIENCE = 2.0  # timeout in s for the missing records of a stream that has ended


class SegmenterNode(StageNode[SegmenterParameters]):
    """Node that cuts one weigh window for each item from the stream of samples."""

    def __init__(
        self, overrides: dict[str, object] | None = None, *, keep_numbers: bool = False
    ) -> None:
        # Set `_numbers` first, because `destroy_node` needs it even if a parameter is invalid.
        self._numbers = GivenNumbers()
        super().__init__(SegmenterParameters, read_only=True, overrides=overrides)
        self._count = 0  # number of the last item of earlier streams
        if keep_numbers or self.parameters.numbers:
            self._numbers = open_numbers(self, self.parameters.numbers)
        if self._numbers.last:  # The numbers continue at the next thousand after a restart.
            self._count = (self._numbers.last // NUMBERS_AT_ONCE + 1) * NUMBERS_AT_ONCE - 1
        self._segmenter: Segmenter | None = None
        self._watch = SegmenterWatch(self.parameters, time.monotonic())
        self._early: deque[SampleBlock | EyeEdge] = deque(maxlen=_MAX_EARLY)
        self._items_before = 0
        self._last_stamp = 0
        self._reported_samples = 0
        self._blocks_since_report = 0
        self._block_time = 0.0  # duration of the last block in s
        self._stream = 0
        self._end: tuple[int, int] | None = None
        self._items = self.output(ports.ITEMS)
        self._windows = self.held_output(ports.WEIGH_WINDOW, ports.DENOISED_WINDOW)
        self._status = self.output(ports.SEGMENTER_STATUS)
        self._zero_settings = self.output(ports.ZERO_SETTING)
        self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        self._events = tuple(
            self.subscribe(port, self._on_event)
            for port in (ports.LOAD_CELL_SAMPLES, ports.PHOTO_EYES)
        )
        self.subscribe(ports.DRIVER_STATUS, self._on_driver_status)
        self._answer_timer = self.create_one_shot_timer(self._answer)
        self._end_timer = self.create_one_shot_timer(self._finish_incomplete)
        self._stall_timer = self.create_one_shot_timer(self._go_by_edges)
        self._zero_requests: list[Future] = []
        # Give the service its own callback group, so that samples are processed during a request.
        self._zero_group = ReentrantCallbackGroup()
        self.create_service(Trigger, ports.ZERO, self._on_zero, callback_group=self._zero_group)

    def destroy_node(self) -> None:
        """Destroy the node and close its file of item numbers."""
        self._numbers.close()
        super().destroy_node()

    async def _on_zero(self, request: Any, response: Any) -> Any:
        """Request a new zero, and answer when an empty belt has set it or the request failed."""
        if self._segmenter is None:
            response.message = 'no load_cell/info has arrived: not zeroed'
            return response
        if reason := await self.change_record.write(changes.ZERO, ports.ZERO, 'requested'):
            response.message = f'{reason}: not zeroed'
            return response
        answer: Future = Future()
        # Wake up the executor, because another thread completes the answer.
        answer.add_done_callback(lambda _: self.executor.wake())
        self._zero_requests.append(answer)
        self._segmenter.zero_keeper.request()
        none = False, f'no answer from the belt within {_ZERO_PATIENCE:g} s: not zeroed'
        found = await in_time(self, self._zero_group, answer, _ZERO_PATIENCE)
        response.success, response.message = found or none
        return response

    def _answer_zero(self, done: bool, text: str) -> None:
        requests, self._zero_requests = self._zero_requests, []
        for request in requests:
            request.set_result((done, text))

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        self.parameters.check_lengths(load_cell)
        if self._segmenter is not None:
            if load_cell == self._segmenter.load_cell:
                return
            self.warn('load_cell/info has changed: the items on the belt are faults')
        self.diagnostics.set_hardware(load_cell)
        self._start(load_cell)
        while self._early:
            self._on_event(self._early.popleft())

    def _start(self, load_cell: LoadCell) -> None:
        """Begin a new stream.

        Items of the previous stream that are still on the belt become faults. Waiting requests to
        set the zero fail, because they belong to the previous stream.
        """
        self._watch.begin_stream(time.monotonic(), load_cell)
        before = self._segmenter
        if before is not None:
            self._publish(before, before.give_up(Reason.SOURCE_RESTARTED))
            self._items_before += before.cutter.count
            self._count = before.item_count
            self._answer_zero(False, 'a new stream has begun: not zeroed')
        self._segmenter = Segmenter(
            load_cell, self.parameters, self._count, Failures(self.item_failed)
        )

    def _on_event(self, event: SampleBlock | EyeEdge) -> None:
        segmenter = self._segmenter
        if segmenter is None:
            self._early.append(event)
            self.warn('samples or edges arrive without load_cell/info: no item can be weighed')
            return
        self._watch.add(time.monotonic(), event)
        leaving = segmenter.leaving_since
        self._publish(segmenter, segmenter.take(event))
        if isinstance(event, SampleBlock):
            self._last_stamp = event.stamp
            self._blocks_since_report += 1
            self._stall_timer.clear()
            self._block_time = len(event.counts) / segmenter.load_cell.sample_rate
        if segmenter.edges_wait:
            self._stall_timer.set_by(_in(_STALL_TIME + self._block_time))
        signal = segmenter.samples - self._reported_samples
        if (
            signal >= _STATUS_INTERVAL * segmenter.load_cell.sample_rate
            or self._blocks_since_report >= _STATUS_BLOCKS
            # Without a status, the node `reject` would assume that the leaving item is unknown.
            or segmenter.leaving_since not in (None, leaving)
        ):
            self._publish_status(StreamState.RUNNING)
        answer = segmenter.zero_keeper.answer
        if self._zero_requests and answer is not None:
            if answer.change is not None:
                self._zero_settings.send(answer.change)
                self._watch.set_zero()
            self._answer_zero(answer.change is not None, answer.text)
        self._finish_if_ended()

    def _go_by_edges(self) -> None:
        """Announce items without their samples, because the samples have stalled."""
        if self._segmenter is not None and self._segmenter.edges_wait:
            self._publish(self._segmenter, self._segmenter.go_by_edges())
            self._publish_status(StreamState.RUNNING)

    def _on_driver_status(self, status: StreamStatus) -> None:
        if status.state != StreamState.RUNNING:
            self._stream = status.stream
            counts = f'{status.samples} samples, {status.edges} edges'
            self.get_logger().info(f'stream {status.stream} ended: {status.state.name}, {counts}')
            self._watch.end_stream(well=status.state == StreamState.FINISHED, text=status.text)
            self._end = (status.samples, status.edges)
            self._end_timer.set(_in(_END_PATIENCE))
            self._finish_if_ended()
        elif status.stream != self._stream:
            self._begin_stream(status.stream)
        elif self._answer_timer.due is None:
            self._publish_status(StreamState.RUNNING)  # The driver waits for this status.

    def _begin_stream(self, stream: int) -> None:
        # Do not restart for the first stream, whose samples may arrive before its first status.
        follows, self._stream = self._stream != 0, stream
        self.get_logger().info(f'stream {stream} began')
        self._end = None
        self._end_timer.clear()
        segmenter = self._segmenter
        if segmenter is not None and follows and segmenter.samples > 0:
            self._start(segmenter.load_cell)
        elif segmenter is not None:
            self._watch.begin_stream(time.monotonic(), segmenter.load_cell)
        self._answer_timer.set(_in(_ANSWER_PERIOD))

    def _answer(self) -> None:
        """Notify the driver that its stream can begin, as soon as all connections are complete.

        Incomplete connections are checked again every 0.01 s. The driver knows whether its
        publishers have found the subscriptions of this node. Only this node knows whether its
        subscriptions have found the publishers of the driver.
        """
        if self._segmenter is None or any(entry.count() == 0 for entry in self._events):
            self._answer_timer.set(_in(_ANSWER_PERIOD))
        else:
            self._publish_status(StreamState.RUNNING)

    def _finish_if_ended(self) -> None:
        """Finish the stream if all records that the driver sent have been processed.

        If records are missing, wait for them for another 2 s.
        """
        if self._end is None or self._segmenter is None:
            return
        if (self._segmenter.samples, self._segmenter.edges) == self._end:
            self._finish(self._segmenter)
        else:
            self._end_timer.set(_in(_END_PATIENCE))

    def _finish_incomplete(self) -> None:
        """Finish the stream although records are missing."""
        if self._end is None or self._segmenter is None:
            return
        samples, edges = self._end
        self.warn(
            f'the stream has ended: {samples} samples and {edges} edges were sent, but '
            f'{self._segmenter.samples} and {self._segmenter.edges} have arrived'
        )
        self._finish(self._segmenter)

    def _finish(self, segmenter: Segmenter) -> None:
        self._end = None
        self._end_timer.clear()
        self._publish(segmenter, segmenter.finish())
        self._publish_status(StreamState.FINISHED)

    def _publish(self, segmenter: Segmenter, windows: list[WeighWindow]) -> None:
        """Publish the announcements of items, then the windows."""
        for item in segmenter.take_announced():
            if not item.complete:
                # Store the number first, so that a restarted node cannot use it again.
                self._numbers.give(item.item_id)
            self._items.send(replace(item, stream=self._stream))
        for window in windows:
            self._windows.send(window)
            self.count('windows')
            self._watch.add_window(time.monotonic(), window, segmenter)
            for reason in window.reasons:
                self.count(reason)
                self.warn(f'item {window.item_id}: {reason}: {Reason(reason).hint}')

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on samples, clock, photo-eyes, zero, noise and items."""
        if self._segmenter is not None:
            self._watch.look(now, self._segmenter)
        return self._watch.findings(now, time.time() - time.monotonic())

    def _publish_status(self, state: StreamState) -> None:
        segmenter = self._segmenter
        if segmenter is None:
            return
        self._reported_samples = segmenter.samples
        self._blocks_since_report = 0
        self._status.send(
            StreamStatus(
                self._last_stamp,
                self._stream,
                state,
                segmenter.samples,
                segmenter.edges,
                self._items_before + segmenter.cutter.count,
                last_edge=segmenter.last_edge,
            )
        )


def _in(seconds: float) -> int:
    return time.monotonic_ns() + round(seconds * NANOSECONDS)


main = partial(run, partial(SegmenterNode, keep_numbers=True))

if __name__ == '__main__':
    main()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publication of the events of a source. A replay or a simulation can wait for other nodes."""

from collections.abc import Callable, Iterator
from dataclasses import replace
import math
import threading
import time
from typing import Any

from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from checkweigher_core.block_cutting import cut_for_pace
from checkweigher_core.pacing import FlowControl, Pacer
from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, SampleBlock, StreamState, StreamStatus
from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.connections import has_matched_all
from checkweigher_core.ros.outputs import LOCK
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_driver.devices import DriverParameters
from checkweigher_driver.health import DriverWatch
from checkweigher_driver.sources import Source

# Times in s, from the start of a stream of events, at which the status is repeated. A subscriber
# that is visible in the ROS graph may not be connected yet, and would get the first status only
# with the next DDS heartbeat after 3 s. Without the first status, a subscriber would assign items
# to the previous stream.
_REPEATS = (0.2, 0.5, 1.0)
# Longest wait in s for nodes that may be missing, and for edges that the segmenter may have missed.
_PATIENCE = 5.0
# Longest wait in s for the last read of a source.
_END_PATIENCE = 2.0
# Period in s with which a waiting thread checks its condition, because not all changes wake it.
_PERIOD = 0.02
_REMINDER = 5.0  # time in s until the first warning about a wait, and between two warnings


class SourceStream:
    """Publisher of the events of a source. Each stream has its own thread.

    The thread holds the lock of the process while it sends an event, but not while it waits for
    events. `note` is called with each event before it is sent. `machine_ready` returns whether the
    outputs of the machine, if any, can be switched. `failure` is the message of the error that
    ended the latest stream, or an empty string. The caller sets `reject_ready` to true while the
    reject node is active, otherwise to false.
    """

    def __init__(
        self,
        node: StageNode[Any],
        parameters: DriverParameters,
        watch: DriverWatch,
        note: Callable[[Event], None],
        machine_ready: Callable[[], bool],
    ) -> None:
        self._load_cell = node.output(ports.LOAD_CELL_INFO)
        self._samples = node.output(ports.LOAD_CELL_SAMPLES)
        self._eyes = node.output(ports.PHOTO_EYES)
        self._references = node.output(ports.REFERENCE_MASS)
        self.status = node.output(ports.DRIVER_STATUS)
        self._clock = (
            node.create_publisher(Clock, '/clock', 1) if parameters.publish_clock else None
        )
        self.reject_ready = False
        self._node = node
        self._parameters = parameters
        self._watch = watch
        self._note = note
        self._machine_ready = machine_ready
        self._changed = threading.Condition(LOCK)
        self._running = False
        self._announce(0)

    def _announce(self, number: int) -> None:
        self._stopping = False
        self._flow = FlowControl()
        self._progress = StreamStatus(0, number, StreamState.RUNNING, 0, 0)
        self._answered = False
        self.failure = self._trouble = ''
        self._flows = False  # whether events are being sent
        self._repeats: list[float] = []  # monotonic times in s at which to repeat the status

    def begin(self, source: Source) -> None:
        """Begin a new stream of the events of `source`, in a new thread."""
        with LOCK:
            self._announce(time.time_ns())  # the time serves as a unique number of the stream
            self._running = True
        threading.Thread(target=self._run, args=(source,), name='source', daemon=True).start()

    def end(self, close: Callable[[], None] | None = None) -> bool:
        """End the stream; return whether it was still running.

        `close` is a function that closes the source. `close` must be given if a read of the source
        may block, because this read would otherwise not end. The method waits for the end of the
        thread. If the thread has not ended after 2 s, a warning is logged, and the method returns.
        """
        was_running = self._running
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        if close is not None:
            close()
        with self._changed:
            if not self._changed.wait_for(lambda: not self._running, _END_PATIENCE):
                self._node.warn(f'source {self._parameters.source}: the last read does not end')
        return was_running

    def report(self, state: StreamState, text: str = '') -> None:
        """Publish the state and the progress of the stream, with the text of a fault, if any.

        A fault of a running stream is published only while events are sent.
        """
        with LOCK:
            if text and state == StreamState.RUNNING and not self._flows:
                return
            self._flows &= state == StreamState.RUNNING
            self.status.send(replace(self._progress, state=state, text=text))

    def report_trouble(self, trouble: str) -> None:
        """Publish the present fault of the machine if it differs from the last published fault.

        `trouble` is empty if there is no fault. Nothing is published while no events are sent.
        """
        if trouble != self._trouble and self._flows:
            self._trouble = trouble
            self.report(StreamState.RUNNING, trouble)
            if trouble:
                self._node.warn(trouble)

    def on_segmenter_status(self, status: StreamStatus) -> None:
        """Update the flow control with the progress that the segmenter reports.

        Progress in an earlier stream is ignored.
        """
        with self._changed:
            if status.stream != self._progress.stream:
                return
            flow = self._flow
            if not self._answered:
                self._answered = True
                flow.items_judged = status.items
            flow.taken(status.samples, status.edges, status.items)
            self._changed.notify_all()

    def on_verdict(self) -> None:
        """Count one verdict for the flow control."""
        with self._changed:
            self._flow.items_judged += 1
            self._changed.notify_all()

    def _run(self, source: Source) -> None:
        """Send events until the source ends, and report its end or failure.

        If `end` was called, nothing is reported.
        """
        failure: str | None = None
        try:
            self._send_all(source)
        except Exception as error:
            failure = str(error)
        with self._changed:
            if not self._stopping:
                # Report the end, because the other nodes then give the items on the belt the
                # decision FAULT.
                self._watch.end(failure)
                if failure is None:
                    self.report(StreamState.FINISHED)
                else:
                    self.failure = failure
                    self._node.get_logger().error(f'source {self._parameters.source}: {failure}')
                    self.report(StreamState.FAILED, failure)
            self._running = False
            self._changed.notify_all()

    def _send_all(self, source: Source) -> None:
        self._load_cell.send(source.load_cell, stamp=source.start_stamp)
        self.report(StreamState.RUNNING)
        lossless = source.paced and self._parameters.lossless
        if not self._line_is_there(lossless=lossless):
            return
        rate = source.load_cell.sample_rate
        self._flows = True
        self._repeats = [time.monotonic() + seconds for seconds in _REPEATS]
        for event in self._events(source, rate):
            if lossless and not self._line_has_come_so_far(event, rate):
                return
            with LOCK:
                if self._stopping:
                    return
                self._send(event)

    def _events(self, source: Source, rate: float) -> Iterator[Event]:
        """Yield the events of a source. An event of a paced source is yielded when it is due."""
        if not source.paced:
            yield from source
            return
        pace, pacer = self._parameters.rate, None
        for event in cut_for_pace(source, rate, pace, self._parameters.block_time):
            # The pacer starts at the first event, because a simulation needs some time before it
            # yields this event.
            pacer = pacer or Pacer(pace, rate, time.monotonic())
            with self._changed:
                left = max(pacer.due(event) - time.monotonic(), 0.0)
                self._changed.wait_for(lambda: self._stopping, left)
            yield event

    def _send(self, event: Event) -> None:
        """Send an event, after a repetition of the status if a repetition is due."""
        if self._repeats and time.monotonic() > self._repeats[0]:
            del self._repeats[0]
            self.report(StreamState.RUNNING, self._trouble)
        self._note(event)
        self._flow.sent(event)
        before = self._progress
        if isinstance(event, SampleBlock):
            samples = before.samples + len(event.counts)
            self._progress = replace(before, stamp=event.stamp, samples=samples)
            self._samples.send(event)
            self._node.count('blocks')
            if self._clock is not None:
                self._clock.publish(Clock(clock=Time(nanoseconds=event.stamp).to_msg()))
        elif isinstance(event, EyeEdge):
            self._progress = replace(before, edges=before.edges + 1)
            self._eyes.send(event)
            self._node.count('edges')
        else:
            self._references.send(event)

    def _line_has_come_so_far(self, event: Event, rate: float) -> bool:
        """Wait until the flow control allows an event to be sent.

        Returns False if `end` was called in the meantime, otherwise True.
        """
        flow = self._flow

        def ask(waited: float) -> None:
            # Without further samples, the segmenter reports its progress only in answer to a status
            # of the driver. Therefore publish a status while edges are awaited.
            if flow.awaits_edges(event, rate):
                self.report(StreamState.RUNNING, self._trouble)
                if waited > _PATIENCE and (lost := flow.give_up_edges()):
                    self._node.warn(f'{lost} photo-eye edges have not reached the segmenter')

        return self._wait_for(
            lambda: flow.may_send(event, rate), 'segmenter and verdicts to catch up', ask=ask
        )

    def _line_is_there(self, *, lossless: bool) -> bool:
        """Wait for the nodes that receive the stream.

        A lossless stream waits without a time limit for the segmenter and the `listeners`. All
        other waits end after 5 s with a warning, because a device does not wait, and a graph may
        have no reject node. Returns False if `end` was called in the meantime, otherwise True, also
        if nodes are still missing.
        """
        wanted = self._parameters.listeners
        what = f'a segmenter and {wanted} other listeners' if wanted else 'a segmenter'
        if lossless and not self._wait_for(lambda: self.has_listeners(wanted), what):
            return False
        ready = self._wait_for(lambda: not self._missing(), '', patience=_PATIENCE)
        if ready and (missing := self._missing()):
            self._node.warn(f'the stream begins without {" and ".join(missing)}')
        return ready

    def _missing(self) -> list[str]:
        """Return the names of the parts of the line that are not ready yet."""
        outputs = self._load_cell, self._samples, self._eyes, self._references, self.status
        there = {
            'a segmenter': self.has_listeners,
            'an active reject node': self._has_reject,
            'outputs that can be switched': self._machine_ready,
            # Otherwise a recorder would lose the beginning of the stream.
            'some of the subscribers that DDS shows': lambda: has_matched_all(self._node, *outputs),
        }
        return [what for what, is_there in there.items() if not is_there()]

    def _has_reject(self) -> bool:
        """Return whether a reject node is active and receives the edges."""
        requests = self._node.resolve_topic_name(ports.STOP_REQUEST.name)
        return (
            self.reject_ready
            and self._node.count_publishers(requests) > 0
            and has_matched_all(self._node, self._eyes)
        )

    def has_listeners(self, others: int = 0) -> bool:
        """Return whether the segmenter and at least `others` other subscribers are connected.

        The segmenter counts as connected when it has reported its progress in this stream. The
        other subscribers are subscribers of the samples.
        """
        return (
            self._answered
            and self._samples.count() > others
            and self._eyes.count() > 0
            and self.status.count() > 0
        )

    def _wait_for(
        self,
        condition: Callable[[], bool],
        what: str,
        patience: float = math.inf,
        ask: Callable[[float], None] | None = None,
    ) -> bool:
        """Wait until a condition holds, for at most `patience` s.

        Returns False if `end` was called in the meantime, otherwise True, also if the condition
        does not hold yet. `what` is the name of the condition in the warning that is logged every
        5 s, or an empty string for no warning. After each failed check, `ask` is called with the
        waiting time in s so far.
        """
        began = reminded = time.monotonic()
        with self._changed:
            while not (self._stopping or condition()):
                now = time.monotonic()
                if now - began > patience:
                    break
                if ask is not None:
                    ask(now - began)
                if what and now - reminded > _REMINDER:
                    reminded = now
                    self._watch.waits_for = what
                    self._node.warn(f'the source is held back: waiting for {what}')
                self._changed.wait(_PERIOD)
            return not self._stopping

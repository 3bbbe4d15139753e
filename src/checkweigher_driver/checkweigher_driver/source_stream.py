# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stream of a source: announced, sent in step with the line behind it, and ended."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
import threading
import time
from typing import Any

from checkweigher_core.pacing import FlowControl, Pacer
from checkweigher_core.recording import Event
from checkweigher_core.records import (
    EyeEdge,
    SampleBlock,
    StreamState,
    StreamStatus,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.connections import has_matched_all
from checkweigher_core.ros.outputs import LOCK
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_driver.devices import DriverParameters
from checkweigher_driver.health import DriverWatch
from checkweigher_driver.sources import Source
from checkweigher_driver.stoppable_waits import StoppableWaits
from checkweigher_recording.block_cutting import cut_for_pace

_PATIENCE = 5.0  # s without the line behind it
_END_PATIENCE = 2.0  # s, for the last read of a source
# s from the beginning of a stream on, when its status is sent again. A reader that DDS shows to be
# there may not know the writer yet, and hears of a stream with the next heartbeat, after 3 s: it
# would take the first items for those of another stream.
_REPEATS = (0.2, 0.5, 1.0)
_MAX_EDGES = 400  # of the history: 20 s and more at five items a second


@dataclass(frozen=True, slots=True)
class StreamHistory:
    """The latest edges of a stream, and the time of its last sample in ns."""

    stamp: int
    edges: tuple[EyeEdge, ...] = ()


class SentStream:
    """Events of one stream, by its number; `flow` counts those on their way to the line."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.flow = FlowControl()
        self.edges_sent = 0
        self._stamp = 0  # ns, of the last block
        self._edges: deque[EyeEdge] = deque(maxlen=_MAX_EDGES)

    def add(self, event: Event) -> None:
        """Take an event that is about to be sent."""
        self.flow.sent(event)
        if isinstance(event, SampleBlock):
            self._stamp = event.stamp
        elif isinstance(event, EyeEdge):
            self._edges.append(event)
            self.edges_sent += 1

    def history(self) -> StreamHistory:
        """Return the latest edges."""
        return StreamHistory(self._stamp, tuple(self._edges))

    def status(self, state: StreamState, text: str) -> StreamStatus:
        """Return how far the stream is."""
        return StreamStatus(
            self._stamp, self.number, state, self.flow.samples_sent, self.edges_sent, text=text
        )


class SourceStream:
    """Send the events of a source, one stream after the other, each in a thread of its own.

    The thread has the lock of the process while it sends, in one process until all that follows
    from an event has been done, and never while it waits or reads. `note` is called with each event
    before it is sent; `machine_ready` tells whether the outputs of the machine can be switched.
    `sent` is the latest stream, `failure` how its source failed, empty if it did not.
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
        self._reject_ready = False
        self._node = node
        self._parameters = parameters
        self._watch = watch
        self._note = note
        self._machine_ready = machine_ready
        self._waits = StoppableWaits(LOCK)
        self._running = False
        self._announce(0)

    def _announce(self, number: int) -> None:
        self._waits.stopping = False
        self.sent = SentStream(number)
        self._answered = False
        self.failure = self._trouble = ''
        self._flows = False  # whether samples do, so that trouble of the machine is of interest
        self._repeats: list[float] = []  # when the status is sent again, s

    def begin(self, source: Source) -> None:
        """Begin a new stream."""
        with self._waits.change():
            self._announce(time.time_ns())  # no other driver's number
            self._running = True
        threading.Thread(target=self._run, args=(source,), name='source', daemon=True).start()

    def end(self, close: Callable[[], None] | None = None) -> bool:
        """End the stream; return whether it was still going on.

        `close` closes the source, where only that ends a read that blocks.
        """
        going_on = self._running
        with self._waits.change():
            self._waits.stopping = True
        if close is not None:
            close()
        if not self._waits.for_end(lambda: not self._running, _END_PATIENCE):
            self._node.warn(f'source {self._parameters.source}: a read does not end')
        return going_on

    def report(self, state: StreamState, text: str = '') -> None:
        """Send how far the stream is; once it has ended, no trouble any more."""
        with LOCK:
            if text and state == StreamState.RUNNING and not self._flows:
                return
            self._flows &= state == StreamState.RUNNING
            self.status.send(self.sent.status(state, text))

    def tell_trouble(self, trouble: str) -> None:
        """Report what is wrong with the machine, empty for nothing, if that has changed."""
        if trouble != self._trouble and self._flows:
            self._trouble = trouble
            self.report(StreamState.RUNNING, trouble)
            if trouble:
                self._node.warn(trouble)

    def hear_segmenter(self, status: StreamStatus) -> None:
        """Take how far the segmenter is."""
        with self._waits.change():
            if status.stream != self.sent.number:
                return
            flow = self.sent.flow
            if not self._answered:
                self._answered = True
                flow.items_judged = status.items
            flow.taken(status.samples, status.edges, status.items)

    def hear_verdict(self) -> None:
        """Count a verdict."""
        with self._waits.change():
            self.sent.flow.judged()

    def hear_reject(self, *, ready: bool) -> None:
        """Take whether the reject node says that it is active."""
        with self._waits.change():
            self._reject_ready = ready

    def _run(self, source: Source) -> None:
        """Send until the source ends, and report how it ended."""
        failure: str | None = None
        try:
            self._send_all(source)
        except Exception as error:
            failure = str(error)
        with self._waits.change():
            if not self._waits.stopping:
                # If the source broke, the line must hear of it: items on the belt are faults.
                self._watch.end(failure)
                if failure is None:
                    self.report(StreamState.FINISHED)
                else:
                    self.failure = failure
                    text = f'source {self._parameters.source}: {failure}'
                    self._node.get_logger().error(text)
                    self.report(StreamState.FAILED, failure)
            self._running = False

    def _send_all(self, source: Source) -> None:
        self._load_cell.send(source.load_cell, stamp=source.start_stamp)
        self.report(StreamState.RUNNING)
        lossless = source.paced and self._parameters.lossless
        if not self._line_is_there(source):
            return
        rate = source.load_cell.sample_rate
        self._flows = True
        self._repeats = [time.monotonic() + seconds for seconds in _REPEATS]
        pace, pacer = self._parameters.rate, None
        events = cut_for_pace(source, rate, pace, self._parameters.block_time)
        for event in events if source.paced else source:
            pacer = pacer or Pacer(pace, rate, time.monotonic())  # a simulation begins late
            if source.paced and not self._waits.until(pacer.due(event)):
                return
            if lossless and not self._line_has_come_so_far(event, rate):
                return
            with LOCK:
                if self._waits.stopping:
                    return
                if self._repeats and time.monotonic() > self._repeats[0]:
                    del self._repeats[0]
                    self.report(StreamState.RUNNING, self._trouble)
                self._send(event)

    def _send(self, event: Event) -> None:
        self._note(event)
        self.sent.add(event)
        if isinstance(event, SampleBlock):
            self._samples.send(event)
            self._node.count('blocks')
        elif isinstance(event, EyeEdge):
            self._eyes.send(event)
            self._node.count('edges')
        else:
            self._references.send(event)

    def _line_has_come_so_far(self, event: Event, rate: float) -> bool:
        """Wait until the line is ready for an event; return whether to go on."""
        flow = self.sent.flow

        def ask(waited: float) -> None:
            # The segmenter tells of edges with the samples. If none come, it has to be asked.
            if flow.awaits_edges(event, rate):
                self.report(StreamState.RUNNING, self._trouble)
                if waited > _PATIENCE and (lost := flow.give_up_edges()):
                    self._node.warn(f'{lost} photo-eye edges have not come to the segmenter')

        return self._wait_for(
            lambda: flow.may_send(event, rate), 'segmenter and verdicts to catch up', ask=ask
        )

    def _line_is_there(self, source: Source) -> bool:
        """Wait for the line behind the driver; return whether to go on.

        A recording waits for a segmenter, and for the listeners that were asked for, as long as it
        takes. The wait for the reject node ends, for a graph that only cuts windows has none.
        """
        if source.paced and not self._parameters.lossless:
            return True
        wanted = self._parameters.listeners
        what = f'a segmenter and {wanted} other listeners' if wanted else 'a segmenter'
        if source.paced and not self._wait_for(lambda: self.has_listeners(wanted), what):
            return False
        ready = self._wait_for(lambda: not self._missing(), '', patience=_PATIENCE)
        if ready and (missing := self._missing()):
            self._node.warn(f'the stream begins without {" and ".join(missing)}')
        return ready

    def _missing(self) -> list[str]:
        """Return the parts of the line that are not there yet."""
        there = {
            'a segmenter': self.has_listeners,
            'an active reject node': self._has_reject,
            'outputs that can be switched': self._machine_ready,
            # A recorder gets all, too.
            'some of the subscribers that DDS shows': self._has_matched_all,
        }
        return [what for what, is_there in there.items() if not is_there()]

    def _has_matched_all(self) -> bool:
        outputs = self._load_cell, self._samples, self._eyes, self._references, self.status
        return has_matched_all(self._node, *outputs)

    def _has_reject(self) -> bool:
        """Tell whether a reject node reports that it is active, and takes the edges."""
        requests = self._node.resolve_topic_name(ports.STOP_REQUEST.name)
        return (
            self._reject_ready
            and self._node.count_publishers(requests) > 0
            and has_matched_all(self._node, self._eyes)
        )

    def has_listeners(self, others: int = 0) -> bool:
        """Tell whether driver and segmenter have found each other, and others the samples."""
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
        """Wait until a condition holds or `patience` s are over; return whether to go on."""

        def remind() -> None:
            self._watch.waits_for(what)
            self._node.warn(f'the source is held back: waiting for {what}')

        return self._waits.for_condition(condition, patience, ask, remind if what else None)

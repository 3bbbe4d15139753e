"""The stream of a source: announced, sent in step with the line behind it, and ended."""

from collections.abc import Callable
from dataclasses import dataclass
import math
import threading
import time
from typing import Any

from checkweigher_driver.devices import DriverParameters
from checkweigher_driver.health import DriverWatch
from checkweigher_driver.sources import Source
from checkweigher_driver.stoppable_waits import StoppableWaits
from checkweigher_driver.stream_memory import StreamMemory
from checkweigher_driver.stream_report import StreamReport
from checkweigher_dsp.records import EyeEdge, SampleBlock, StreamState, StreamStatus, Verdict
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.connections import has_matched_all
from checkweigher_dsp.ros.outputs import LOCK, Output
from checkweigher_dsp.ros.stage_node import StageNode
from checkweigher_recording.block_cutting import cut_for_pace
from checkweigher_recording.pacing import FlowControl, Pacer
from checkweigher_recording.recording import Event

_PATIENCE = 5.0  # s without the line behind it before that is said
_END_PATIENCE = 2.0  # s, for the last read of a source


@dataclass(frozen=True)
class StreamOutputs:
    """Where the driver sends."""

    load_cell: Output
    samples: Output
    eyes: Output
    references: Output
    status: Output

    @classmethod
    def of(cls, node: StageNode[Any]) -> 'StreamOutputs':
        """Return the outputs of a driver."""
        return cls(
            node.output(ports.LOAD_CELL_INFO),
            node.output(ports.LOAD_CELL_SAMPLES),
            node.output(ports.PHOTO_EYES),
            node.output(ports.REFERENCE_MASS),
            node.output(ports.DRIVER_STATUS),
        )

    @property
    def all(self) -> tuple[Output, ...]:
        """All of them."""
        return self.load_cell, self.samples, self.eyes, self.references, self.status


class SourceStream:
    """Send what a source delivers, one stream after the other, each in a thread of its own.

    The thread has the lock of the process while it sends, in one process until all that follows
    from an event has been done, and never while it waits or reads.

    Parameters
    ----------
    node : StageNode
        The driver, which knows the graph.
    parameters : DriverParameters
        Pace of a recording, and what it waits for.
    watch : DriverWatch
        Hears what is waited for, and how a source ended.
    note : callable
        Called with each event before it is sent.
    machine_ready : callable
        Tells whether the outputs of the machine can be switched.

    Attributes
    ----------
    memory : StreamMemory
        Of the latest stream.
    reject_ready : bool
        Whether the reject node says that it is active.
    failure : str
        How the source of the latest stream failed; empty if it did not.
    """

    def __init__(
        self,
        node: StageNode[Any],
        parameters: DriverParameters,
        watch: DriverWatch,
        note: Callable[[Event], None],
        machine_ready: Callable[[], bool],
    ) -> None:
        self.outputs = StreamOutputs.of(node)
        self.reject_ready = False
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
        self._flow = FlowControl()
        self.memory = StreamMemory(number)
        self._answered = False
        self.failure = self._trouble = ''
        self._report = StreamReport(self.outputs.status, self.memory, self._flow)

    def begin(self, source: Source) -> None:
        """Begin a new stream."""
        with self._waits.change():
            self._announce(time.time_ns())  # no other driver's number
            self._running = True
        threading.Thread(target=self._run, args=(source,), name='source', daemon=True).start()

    def end(self, close: Callable[[], None] | None = None) -> bool:
        """End the stream; return whether it was still going on.

        Parameters
        ----------
        close : callable, optional
            Closes the source, where only that ends a read that blocks.
        """
        going_on = self._running
        with self._waits.change():
            self._waits.stopping = True
        if close is not None:
            close()
        if not self._waits.for_end(lambda: not self._running, _END_PATIENCE):
            self._node.warn(f'source {self._parameters.source}: a read does not end')
        return going_on

    def report_end(self, text: str) -> None:
        """Say that the stream has ended before its source has."""
        self._report.send(StreamState.FINISHED, text)

    def tell_trouble(self, trouble: str) -> None:
        """Say what is wrong with the machine, empty for nothing, if that has changed."""
        if trouble != self._trouble and self._report.open:
            self._trouble = trouble
            self._report.send(StreamState.RUNNING, trouble)
            if trouble:
                self._node.warn(trouble)

    def hear_segmenter(self, status: StreamStatus) -> None:
        """Take how far the segmenter is."""
        with self._waits.change():
            if status.stream != self.memory.stream:
                return
            if not self._answered:
                self._answered = True
                self._flow.items_judged = status.items
            self._flow.taken(status.samples, status.edges, status.items)

    def hear_verdict(self, verdict: Verdict) -> None:
        """Take a verdict."""
        self.memory.add_verdict(verdict)
        with self._waits.change():
            # As the segmenter counts.
            self._flow.judged(verdict.estimate_id or verdict.item_id)

    def hear_reject(self, *, ready: bool) -> None:
        """Take whether the reject node says that it is active."""
        with self._waits.change():
            self.reject_ready = ready

    def _run(self, source: Source) -> None:
        """Send until the source ends, and say how it ended."""
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
                    self._report.send(StreamState.FINISHED)
                else:
                    self.failure = failure
                    text = f'source {self._parameters.source}: {failure}'
                    self._node.get_logger().error(text)
                    self._report.send(StreamState.FAILED, failure)
            self._running = False

    def _send_all(self, source: Source) -> None:
        self.outputs.load_cell.send(source.load_cell, stamp=source.start_stamp)
        self._report.send(StreamState.RUNNING)
        lossless = source.paced and self._parameters.lossless
        if not self._line_is_there(source):
            return
        rate = source.load_cell.sample_rate
        self._report.begin()
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
                self._report.say_again(self._trouble)
                self._send(event)

    def _send(self, event: Event) -> None:
        self._note(event)
        self._flow.sent(event)
        if isinstance(event, SampleBlock):
            self.memory.stamp = event.stamp
            self.outputs.samples.send(event)
            self._node.count('blocks')
        elif isinstance(event, EyeEdge):
            self.memory.add_edge(event)
            self.outputs.eyes.send(event)
            self._node.count('edges')
        else:
            self.outputs.references.send(event)

    def _line_has_come_so_far(self, event: Event, rate: float) -> bool:
        """Wait until the line is ready for an event; return whether to go on."""

        def ask(waited: float) -> None:
            # The segmenter tells of edges with the samples. If none come, it has to be asked.
            if self._flow.awaits_edges(event, rate):
                self._report.send(StreamState.RUNNING, self._trouble)
                if waited > _PATIENCE and (lost := self._flow.give_up_edges()):
                    self._node.warn(f'{lost} photo-eye edges have not come to the segmenter')

        return self._wait_for(
            lambda: self._flow.may_send(event, rate), 'segmenter and verdicts to catch up', ask=ask
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
        """Return what of the line is not there yet."""
        there = {
            'a segmenter': self.has_listeners,
            'an active reject node': self._has_reject,
            'outputs that can be switched': self._machine_ready,
            # A recorder gets all, too.
            'some of the subscribers that DDS shows': self._has_matched_all,
        }
        return [what for what, is_there in there.items() if not is_there()]

    def _has_matched_all(self) -> bool:
        return has_matched_all(self._node, *self.outputs.all)

    def _has_reject(self) -> bool:
        """Tell whether a reject node says that it is active, and takes the edges."""
        requests = self._node.resolve_topic_name(ports.STOP_REQUEST.name)
        return (
            self.reject_ready
            and self._node.count_publishers(requests) > 0
            and has_matched_all(self._node, self.outputs.eyes)
        )

    def has_listeners(self, others: int = 0) -> bool:
        """Tell whether driver and segmenter have found each other, and others the samples."""
        return (
            self._answered
            and self.outputs.samples.count() > others
            and self.outputs.eyes.count() > 0
            and self.outputs.status.count() > 0
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

"""The driver node: publishes what a source of samples and photo-eye edges delivers."""

from collections.abc import Callable, Sequence
import math
import threading
import time
from typing import Any

from checkweigher_msgs.msg import StopRequest, StreamStatus
from checkweigher_msgs.srv import LineHistory as LineHistoryService
from rclpy.publisher import Publisher
from std_srvs.srv import Trigger

from checkweigher_driver.calibration.services import CalibrationServices
from checkweigher_driver.calibration.session import CalibrationParameters
from checkweigher_driver.devices import DriverParameters, make_outputs, source_maker
from checkweigher_driver.health import DriverWatch
from checkweigher_driver.sources import Source
from checkweigher_driver.stoppable_waits import StoppableWaits
from checkweigher_driver.stream_memory import StreamMemory
from checkweigher_driver.stream_report import StreamReport
from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.parameters import ParameterError, Parameters
from checkweigher_dsp.reasons import StopReason
from checkweigher_dsp.records import EyeEdge, Reference, SampleBlock
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.connections import has_matched_all
from checkweigher_dsp.ros.conversion import (
    edge_to,
    fill_history,
    load_cell_to,
    reference_to,
    samples_to,
    verdict_from,
)
from checkweigher_dsp.ros.managed_node import ManagedStageNode
from checkweigher_dsp.ros.ports import Topic
from checkweigher_dsp.ros.stage_node import declare, run
from checkweigher_recording.block_cutting import cut_for_pace
from checkweigher_recording.pacing import FlowControl, Pacer
from checkweigher_recording.recording import Event

_PATIENCE = 5.0  # s without the line behind it before that is said
_LOOK_PERIOD = 0.05  # s, in which trouble of the machine is told at the latest
_END_PATIENCE = 2.0  # s, for the last read of a source


class DriverNode(ManagedStageNode[DriverParameters]):
    """Publish the events of a source: load_cell/info, load_cell/samples and photo_eyes.

    The source is read in a thread of its own, by blocking reads. Each activation is a stream of
    its own. What was sent of it the service line_history tells.
    """

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(DriverParameters, read_only=True, overrides=overrides)
        self._source: Source | None = None

        def read(kind: type[Parameters]) -> Parameters:
            return declare(self, kind, f'{kind.node}.', read_only=True)

        try:
            self._make_source = source_maker(self.parameters.source, self.parameters.eyes, read)
            self._outputs = make_outputs(self.parameters.outputs, read)
            calibration = declare(self, CalibrationParameters, 'calibration.', read_only=True)
        except ParameterError:
            self.destroy_node()
            raise
        self._watch = DriverWatch(self.parameters.source)
        self._waits = StoppableWaits()
        self._thread: threading.Thread | None = None
        self._reject_ready = False
        self._info = self._publisher_of(ports.LOAD_CELL_INFO)
        self._samples = self._publisher_of(ports.LOAD_CELL_SAMPLES)
        self._eyes = self._publisher_of(ports.PHOTO_EYES)
        self._references = self._publisher_of(ports.REFERENCE_MASS)
        self._status = self._publisher_of(ports.DRIVER_STATUS)
        self._begin_stream(0)
        self._streams = (self._samples, self._eyes, self._references, self._status)
        self.subscribe(ports.SEGMENTER_STATUS, self._on_segmenter_status)
        self.subscribe(ports.VERDICT, self._on_verdict, needed=False)
        self.subscribe(ports.STOP_REQUEST, self._on_stop_request, needed=False)
        self.create_service(LineHistoryService, ports.LINE_HISTORY.name, self._on_line_history)
        if self._outputs.exist:
            self.create_service(Trigger, ports.RESET_OUTPUTS, self._reset_outputs)
        self._calibration = CalibrationServices(
            self, calibration, self.parameters.source, lambda: self._memory, self._stream_anew
        )
        self._look_timer = self.create_timer(_LOOK_PERIOD, self._look_after_machine)
        self._look_timer.cancel()
        self.begin()

    def _publisher_of(self, topic: Topic) -> Publisher:
        return self.create_publisher(topic.type, topic.name, topic.qos)

    def _begin_stream(self, number: int) -> None:
        self._waits.stopping = False
        self._flow = FlowControl()
        self._memory = StreamMemory(number)
        self._answered = False
        self._failure = self._trouble = ''
        self._report = StreamReport(self._status, self._memory, self._flow)

    def configure(self) -> None:
        """Open the source."""
        try:
            self._calibration.read()  # before anything is opened
            self._source = self._make_source()
        except ParameterError:
            raise
        except ValueError as error:
            # The bag is damaged, or whatever else keeps the source from being opened.
            raise ParameterError(f'driver.source: {error}') from None
        self._outputs.open()  # safe until activated

    def activate(self) -> None:
        """Begin a new stream."""
        if self._source is None:  # deactivated, which closes what blocks
            self.configure()
        assert self._source is not None
        with self._waits.change():
            self._begin_stream(time.time_ns())  # no other driver's number
        load_cell = self._source.load_cell = self._calibration.apply(self._source.load_cell)
        self._calibration.begin(load_cell)
        self.diagnostics.set_hardware(load_cell)
        self._watch.begin(load_cell, time.monotonic())
        self._outputs.hold(False)
        self._outputs.activate()
        if self._outputs.exist or not self._source.paced:
            self._look_timer.reset()
        self._thread = threading.Thread(target=self._run, name='source', daemon=True)
        self._thread.start()

    def deactivate(self) -> None:
        """End the stream: what is on the belt becomes a fault, and the outputs are safe."""
        self._outputs.safe()
        self._calibration.end()
        self._look_timer.cancel()
        if self._thread is not None and self._stop_reading():
            self._report.publish(StreamStatus.FINISHED, 'the driver was deactivated')
        self._watch.stop()

    def clean_up(self) -> None:
        """Close source and outputs."""
        self._close_source()
        self._outputs.close()

    def _close_source(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None

    def last_words(self) -> list[Publisher]:
        """Return the publisher of the end of the stream."""
        return [self._status]

    def destroy_node(self) -> None:
        """Stop reading the source, then destroy the node."""
        if hasattr(self, '_thread'):
            self._stop_reading()
            self.clean_up()
        super().destroy_node()

    def _stop_reading(self) -> bool:
        """End the thread; return whether the stream was still going on."""
        thread, self._thread = self._thread, None
        if thread is None:
            return False
        with self._waits.change():
            self._waits.stopping = True
        going_on = thread.is_alive()
        if self._source is not None and not self._source.paced:
            self._close_source()  # only that ends a read that blocks
        thread.join(timeout=_END_PATIENCE)
        if thread.is_alive():
            self.warn(f'source {self.parameters.source}: a read does not end')
        return going_on

    def _on_segmenter_status(self, message: Any) -> None:
        with self._waits.change():
            if message.stream != self._memory.stream:
                return
            if not self._answered:
                self._answered = True
                self._flow.items_judged = int(message.items)
            self._flow.taken(int(message.samples), int(message.edges), int(message.items))

    def _on_verdict(self, message: Any) -> None:
        verdict = verdict_from(message)
        self._outputs.verdict(verdict)  # before all else: the rejector waits
        self._memory.add_verdict(verdict)
        number = verdict.estimate_id or verdict.item_id  # as the segmenter counts
        with self._waits.change():
            self._flow.judged(number)

    def _on_stop_request(self, message: Any) -> None:
        stop = message.state != StopRequest.RUN
        self._outputs.take_request(stop, message.reason, message.hint)
        with self._waits.change():
            self._reject_ready = message.reason != StopReason.NOT_READY

    def _look_after_machine(self) -> None:
        """Stop the line while it cannot weigh, and tell it what is wrong when that changes."""
        source = self._source
        if source is None:
            return
        failed = self._failure or source.trouble
        self._outputs.hold(bool(failed))
        name = self.resolve_topic_name(ports.STOP_REQUEST.name)
        if self._outputs.exist and self.count_publishers(name) == 0:
            self._outputs.lose_request()
        trouble = self._outputs.trouble_with(failed)
        if trouble != self._trouble and self._report.open:
            self._trouble = trouble
            self._report.publish(StreamStatus.RUNNING, trouble)
            if trouble:
                self.warn(trouble)

    def _reset_outputs(self, request: Any, response: Any) -> Any:
        """Forget products that the rejector can have missed."""
        response.success = True
        response.message = self._outputs.reset() or 'nothing was missed'
        return response

    def _on_line_history(self, request: Any, response: Any) -> Any:
        """Tell what was sent and what verdicts came of it."""
        return fill_history(self._memory.history(), response)

    def _stream_anew(self) -> str:
        """Begin a new stream, as what the load cell is has changed; return why that failed."""
        self.trigger_deactivate()
        self.trigger_activate()
        return '' if self.state == 'active' else self._failure

    def _run(self) -> None:
        """Publish until the source ends, and say how it ended."""
        source = self._source
        assert source is not None
        try:
            self._stream(source)
        except Exception as error:
            if self._waits.stopping:
                return
            # Whatever breaks the source, the line must hear of it: items on the belt are faults.
            self._failure = str(error)
            self._watch.end(str(error))
            self.get_logger().error(f'source {self.parameters.source}: {error}')
            self._report.publish(StreamStatus.FAILED, str(error))
        else:
            if not self._waits.stopping:
                self._watch.end()
                self._report.publish(StreamStatus.FINISHED)

    def _stream(self, source: Source) -> None:
        self._info.publish(load_cell_to(source.load_cell, source.start_stamp))
        self._report.publish(StreamStatus.RUNNING)
        held_back = source.paced and self.parameters.lossless
        if not self._line_is_there(source):
            return
        rate = source.load_cell.sample_rate
        self._report.begin()
        pace, pacer = self.parameters.rate, None
        events = cut_for_pace(source, rate, pace, self.parameters.block_time)
        for event in events if source.paced else source:
            pacer = pacer or Pacer(pace, rate, time.monotonic())  # a simulation begins late
            if self._waits.stopping or (source.paced and not self._waits.until(pacer.due(event))):
                return
            if held_back and not self._line_has_come_so_far(event, rate):
                return
            self._report.say_again(self._trouble)
            self._publish(event)

    def _line_has_come_so_far(self, event: Event, rate: float) -> bool:
        """Wait until the line is ready for an event; return whether to go on."""

        def ask(waited: float) -> None:
            # The segmenter tells of edges with the samples. If none come, it has to be asked.
            if self._flow.awaits_edges(event, rate):
                self._report.publish(StreamStatus.RUNNING, self._trouble)
                if waited > _PATIENCE and (lost := self._flow.give_up_edges()):
                    self.warn(f'{lost} photo-eye edges have not come to the segmenter')

        return self._wait_for(
            lambda: self._flow.may_send(event, rate), 'segmenter and verdicts to catch up', ask=ask
        )

    def _line_is_there(self, source: Source) -> bool:
        """Wait for the line behind the driver; return whether to go on.

        A recording waits for a segmenter, and for the listeners that were asked for, as long as it
        takes. Nothing waits for ever for the reject node, for whoever feeds only the segmenter has
        none.
        """
        if source.paced and not self.parameters.lossless:
            return True
        wanted = self.parameters.listeners
        what = f'a segmenter and {wanted} other listeners' if wanted else 'a segmenter'
        if source.paced and not self._wait_for(lambda: self._has_listeners(wanted), what):
            return False
        ready = self._wait_for(self._has_line, '', patience=_PATIENCE)
        missing = [] if self._has_listeners() else ['a segmenter']
        if not self._has_reject():
            missing.append('an active reject node')
        if not self._outputs.ready:
            missing.append('outputs that can be switched')
        if not has_matched_all(self, self._info, *self._streams):
            missing.append('some of the subscribers that DDS shows')
        if ready and missing:
            self.warn(f'the stream begins without {" and ".join(missing)}')
        return ready

    def _has_line(self) -> bool:
        ready = self._has_listeners() and self._has_reject() and self._outputs.ready
        # A recorder gets all, too.
        return ready and has_matched_all(self, self._info, *self._streams)

    def _has_reject(self) -> bool:
        """Tell whether a reject node says that it is active, and takes the edges."""
        return (
            self._reject_ready
            and self.count_publishers(self.resolve_topic_name(ports.STOP_REQUEST.name)) > 0
            and has_matched_all(self, self._eyes)
        )

    def _has_listeners(self, others: int = 0) -> bool:
        """Tell whether driver and segmenter have found each other, and others the samples."""
        return (
            self._answered
            and self._samples.get_subscription_count() > others
            and self._eyes.get_subscription_count() > 0
            and self._status.get_subscription_count() > 0
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
            self.warn(f'the source is held back: waiting for {what}')

        return self._waits.for_condition(condition, patience, ask, remind if what else None)

    def diagnose(self, now: float) -> list[Finding]:
        """Return how the source, its samples, clock, eyes and the outputs are."""
        source = self._source
        if source is not None and self.state == 'active':
            self._watch.look(source.trouble, source.figures())
        found = self._watch.findings(now, time.time() - time.monotonic())
        return [*found, self._outputs.finding()]

    def _publish(self, event: Event) -> None:
        self._watch.add(time.monotonic(), event)
        self._flow.sent(event)
        if not isinstance(event, Reference):
            self._calibration.add(event)
        if isinstance(event, SampleBlock):
            self._memory.stamp = event.stamp
            self._samples.publish(samples_to(event))
            self.count('blocks')
        elif isinstance(event, EyeEdge):
            self._memory.add_edge(event)
            self._outputs.edge(event)
            self._eyes.publish(edge_to(event))
            self.count('edges')
        elif isinstance(event, Reference):
            self._references.publish(reference_to(event))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the node."""
    run(DriverNode, arguments)


if __name__ == '__main__':
    main()

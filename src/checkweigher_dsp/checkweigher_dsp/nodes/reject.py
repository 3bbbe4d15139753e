# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reject node: photo_eyes and mass_estimate to verdict; with reject_eye to stop_request."""

from functools import partial
import time
from typing import Any

from checkweigher_msgs.srv import LineHistory as LineHistoryService
from rclpy.client import Client
from std_srvs.srv import Trigger

from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.health.items import RejectorWatch, VerdictWatch
from checkweigher_dsp.nodes.given_numbers import GivenNumbers
from checkweigher_dsp.nodes.recall import Recall
from checkweigher_dsp.reasons import Reason, StopReason
from checkweigher_dsp.records import (
    NANOSECONDS,
    ExternalReject,
    Eye,
    EyeEdge,
    LineHistory,
    LoadCell,
    MachineConditions,
    MassEstimate,
    PerformanceState,
    PerformanceTest,
    StopRequest,
    StreamState,
    StreamStatus,
    Verdict,
    foreign,
)
from checkweigher_dsp.rejection.monitoring import RejectMonitor
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.rejection.timing import StreamClock
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.connections import has_matched_all
from checkweigher_dsp.ros.conversion import to_record
from checkweigher_dsp.ros.graph.makers import Makers
from checkweigher_dsp.ros.managed_node import ManagedStageNode
from checkweigher_dsp.ros.one_shot_timer import OneShotTimer
from checkweigher_dsp.ros.outputs import Output
from checkweigher_dsp.ros.port_node import locked
from checkweigher_dsp.ros.running import run

_LOOK_PERIOD = 1.0  # s
_RECALL_PERIOD = 0.01  # s, in which a recall is looked after
_NOT_READY = StopRequest(StopReason.NOT_READY, 0)
_NO_HISTORY = StopRequest(
    StopReason.NOT_READY, 0, text='it waits for the driver to answer line_history; check its load'
)


class RejectNode(ManagedStageNode[RejectParameters]):
    """Give every item that the eyes show its verdict, in time for the rejector.

    Only while it is active: else it asks the line to stop. When it becomes active in the middle of
    a stream, it asks the driver what it has missed. In a process of its own, `alone`, it keeps the
    largest number that it has given for the node that takes its place.
    """

    def __init__(self, overrides: dict[str, object] | None = None, *, alone: bool = False) -> None:
        super().__init__(RejectParameters, overrides=overrides)
        self._verdicts = self.held_output(ports.VERDICT)
        self._stage = RejectStage(self.parameters)
        self._numbers: GivenNumbers | None = None
        if alone:
            domain = self.context.get_domain_id()
            self._numbers = GivenNumbers(self.get_fully_qualified_name(), domain)
            self._stage.number_after(self._numbers.last)
            if self._numbers.trouble:
                self.warn(self._numbers.trouble)
        self._monitor = RejectMonitor(self.parameters)
        self._stream_clock = StreamClock(running=self.parameters.deadlines)
        self._stream = 0
        self._stream_ended = False
        self._active = False
        self._recall: Recall | None = None
        self._history: Client | None = None
        answers = f'rr{self.resolve_service_name(ports.LINE_HISTORY.name)}Reply'
        self._historians = Makers(
            self, answers, 'driver', lambda: self.allowed_publishers, stage=False, mangled=False
        )
        self._status_topic = self.resolve_topic_name(ports.DRIVER_STATUS.name)
        self._eyes_topic = self.resolve_topic_name(ports.PHOTO_EYES.name)
        self._verdict_watch, self._rejector_watch = VerdictWatch(), RejectorWatch()
        self._stop_requests = self.output(ports.STOP_REQUEST)
        self._shown: StopRequest | None = None
        self.create_service(Trigger, ports.RESET_STOP_REQUEST, self._reset)
        self._timer = OneShotTimer(self, self._tick)
        self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        self.subscribe(ports.DRIVER_STATUS, self._on_driver_status)
        self._eyes = self.subscribe(ports.PHOTO_EYES, self._on_edge, doubted=self._doubt)
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate, doubted=foreign)
        self.subscribe(ports.REJECT_EYE, self._on_reject_eye)
        self._external = self.subscribe(
            ports.EXTERNAL_REJECT, self._on_external_reject,
            doubted=lambda reject: reject,  # a stranger's can but reject
        )  # fmt: skip
        self._conditions = self.subscribe(
            ports.MACHINE_CONDITIONS, self._on_conditions, doubted=self._conditions_alone
        )
        self._tests = self.subscribe(
            ports.PERFORMANCE_TEST, self._on_test, doubted=self._test_alone
        )
        self.create_timer(_LOOK_PERIOD, self._look_around)
        self.begin()

    def start(self) -> None:
        """Activate, or say that the line must not run."""
        # After the subscription to the edges is there: see `_driver_hears`.
        self._history = self.create_client(LineHistoryService, ports.LINE_HISTORY.name)
        super().start()
        if self.state == 'unconfigured':
            self._show_stop_request()

    def activate(self) -> None:
        """Begin to judge, and say that the line may run."""
        self._stage.restart()
        self._monitor.restart()
        self._recall = Recall()
        if self._stream:
            self._recall.hear_driver(ended=self._stream_ended)
        self._active = True
        self._stop_requests.send(self._monitor.request)
        self._shown = self._monitor.request
        self._wake()

    def deactivate(self) -> None:
        """Ask the line to stop, and reject what is on it."""
        was_active, self._active = self._active, False
        self._show_stop_request()
        if was_active:
            if self._driver_is_there():
                self._recall = None  # what was kept back is judged after the next activation
            self._settle(None)
            self._publish(self._stage.stop(self._now()))
        self._timer.clear()

    def final_outputs(self) -> list[Output]:
        """Return the outputs of the request to stop and of the last verdicts."""
        return [self._stop_requests, self._verdicts]

    def on_parameters(self) -> None:
        """Begin to use changed limits."""
        self._stage.parameters = self._monitor.parameters = self.parameters
        self._stream_clock.running = self.parameters.deadlines

    def _now(self) -> int | None:
        """Return the time that deadlines run on, None if there are none."""
        return time.monotonic_ns() if self.parameters.deadlines else None

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        self.diagnostics.set_hardware(load_cell)
        self._stage.set_weigh_length(load_cell.weigh_length, self._now())
        self._wake()

    def _on_driver_status(self, status: StreamStatus) -> None:
        if status.stream != self._stream:
            # The first one heard tells of the stream whose edges may be here already.
            if self._stream:
                if self._recall is not None:
                    self._recall.begin_stream()
                self._stage.restart(self._now())
                self._monitor.restart()
                self._wake()
            self._stream = status.stream
        self._stream_ended = status.state != StreamState.RUNNING
        if self._recall is not None:
            self._recall.hear_driver(ended=self._stream_ended)
            self._wake()
        text = status.text if status.state != StreamState.FINISHED else ''
        failed = status.state == StreamState.FAILED
        self._monitor.hear_driver(text or ('its source failed' if failed else ''))
        if self._active:
            self._show_stop_request()

    def _doubt(self, edge: EyeEdge) -> EyeEdge:
        """Take an edge that may be a stranger's: there are items, and no mass of them is known."""
        self._stage.doubted = True
        return edge

    def _on_edge(self, edge: EyeEdge) -> None:
        if self._stage.doubted and not self._eyes.doubted:
            self._stage.restart(self._now())  # of what is on the belt no edge is sure
            self._stage.doubted = False
        if edge.eye == Eye.OUTFEED and edge.blocked:
            self._verdict_watch.add_edge(time.monotonic(), edge.stamp)
        self._stream_clock.saw(edge.stamp, time.monotonic_ns())
        if not self._active:
            return
        self._look_whether_inspected()
        if recall := self._holding():
            recall.edges.append((edge, self._now()))
        else:
            self._publish(self._stage.take(edge, self._now()))
        self._wake()

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if not self._active:
            return
        if recall := self._holding():
            recall.estimates.append(estimate)
        else:
            self._take_estimate(estimate)
            self._publish(self._stage.advance(self._now()))
        self._wake()

    def _take_estimate(self, estimate: MassEstimate) -> None:
        late, unknown = self._stage.late_estimates, self._stage.unknown_estimates
        self._publish(self._stage.take(estimate, self._now()))
        if self._stage.unknown_estimates > unknown:
            self.count(Reason.UNKNOWN_ITEM)
            self.warn(f'item {estimate.item_id}: UnknownItem: {Reason.UNKNOWN_ITEM.hint}')
        if self._stage.late_estimates > late:
            self.count('late estimates')
            self.warn(f'item {estimate.item_id}: its mass came after its verdict')

    def _on_reject_eye(self, edge: EyeEdge) -> None:
        self._stream_clock.saw(edge.stamp, time.monotonic_ns())
        if self._active:
            self._monitor.add_edge(edge)
            self._wake()

    def _on_external_reject(self, reject: ExternalReject) -> None:
        if self._active:
            self._stage.external_reject(reject, time.monotonic_ns())
            self.count('external rejects')
            self._look_after_inspections()
            self._wake()

    def _look_after_inspections(self) -> None:
        """Stop the line for rejects that no verdict could heed."""
        inspections = self._stage.inspections
        missed, inspections.missed = inspections.missed, []
        for each in missed:
            self._monitor.miss(each)
        if missed:
            self._show_stop_request()

    def _on_conditions(self, conditions: MachineConditions) -> None:
        self._monitor.hear_conditions(conditions)
        self._look_whether_inspected()
        if self._active:
            self._show_stop_request()

    def _look_whether_inspected(self) -> None:
        """See whether the inspection devices run, and a node is there to tell what they reject."""
        stamp = self._stream_clock.at(time.monotonic_ns())
        if stamp is None or not self.parameters.devices:
            return
        known = self._monitor.conditions
        running = known.known and StopReason.INSPECTION_FAULT not in known.conditions
        late = round(NANOSECONDS * self.parameters.edge_lateness)
        heard = running and self._external.count() > 0
        self._stage.inspections.set_running(heard, stamp if heard else stamp - late)

    def _conditions_alone(self, conditions: MachineConditions) -> MachineConditions:
        """Take what is wrong from any node, and from a stranger not that all is well."""
        wrong = not conditions.known or conditions.conditions
        return conditions if wrong else self._conditions.refuse_doubted(conditions)

    def _on_test(self, test: PerformanceTest) -> None:
        self._monitor.hear_test(test, time.time_ns())
        if self._active:
            self._show_stop_request()

    def _test_alone(self, test: PerformanceTest) -> PerformanceTest:
        """Take a test that stops the line from any node, and from a stranger no other."""
        stops = test.state in (PerformanceState.OVERDUE, PerformanceState.FAILED)
        return test if stops else self._tests.refuse_doubted(test)

    def _look_around(self) -> None:
        """See whether items are inspected, and whether the grace of a test is over."""
        self._look_whether_inspected()
        if self._active and self._monitor.test is not None:
            self._on_test(self._monitor.test)

    def _holding(self) -> Recall | None:
        """Return what keeps records back, None if nothing has to any more."""
        if self._recall is not None:
            self._recall.begin()
        return self._recall

    def _ask_for_history(self) -> None:
        """Ask the driver once, as soon as that can be done; keep nothing back for too long."""
        recall = self._recall
        if recall is None:
            return
        if recall.may_ask and self._history is not None and self._driver_hears(self._history):
            take = partial(self._on_history, recall, recall.ask())
            answer = self._history.call_async(LineHistoryService.Request())
            answer.add_done_callback(locked(take))
        status, edges = map(self.count_publishers, (self._status_topic, self._eyes_topic))
        if recall.is_over(
            self._stage.weigh_length,
            driver=self._driver_is_there(),
            status=status > 0,
            edges=edges > 0,
        ):
            self._settle(recall.history)

    def _driver_is_there(self) -> bool:
        """Tell whether a driver is there that answers, however long that takes it."""
        if self._historians.held:
            return True
        self._historians.look()
        return self._historians.present

    def _driver_hears(self, history: Client) -> bool:
        """Tell whether the driver answers, and each hears the other from the first message on.

        Its answer then shows that it knows the publisher of the verdicts and the subscription to
        the edges, which were made before the client: DDS tells of them in that order. A verdict
        that others heard and the driver did not would be given once more by the next reject node.
        An item whose edges come neither with the answer nor after it would have no verdict.
        """
        self._historians.look()
        if self._historians.strangers or not history.service_is_ready():
            return False
        if self.count_publishers(self._eyes_topic) > 0 and self._eyes.count() == 0:
            return False
        if self._verdicts.takers:
            return True
        drivers = self.get_publishers_info_by_topic(self._status_topic)
        takers = self.get_subscriptions_info_by_topic(self._verdicts.topic_name)
        names = {(each.node_namespace, each.node_name) for each in drivers}
        hears = any((each.node_namespace, each.node_name) in names for each in takers)
        return hears and has_matched_all(self, self._verdicts)

    def _on_history(self, recall: Recall, has_first: bool, answer: Any) -> None:
        try:
            history: LineHistory = to_record(ports.LINE_HISTORY, answer.result())
        except Exception as error:  # it is asked again
            self.warn(f'{ports.LINE_HISTORY.name}: {type(error).__name__}: {error}')
            return
        if history.stream == self._stream:  # else its status is still on its way, or the answer was
            recall.answer(history, has_first=has_first)
        self._wake()

    def _wake(self) -> None:
        """Have the timer ring when time alone brings something, and not before."""
        now = time.monotonic_ns()
        times = []
        if self.parameters.deadlines:
            times.append(self._stage.due)
        if (due := self._monitor.due) is not None:
            times.append(self._stream_clock.reaches(due, now))
        if (recall := self._recall) is not None and recall.waiting:
            times.append(now + round(_RECALL_PERIOD * NANOSECONDS))
        if known := [due for due in times if due is not None]:
            self._timer.set_by(min(known))
        else:
            self._timer.clear()

    def _settle(self, history: LineHistory | None) -> None:
        """Judge what was missed, then go on with what was kept back meanwhile."""
        recall, self._recall = self._recall, None
        if recall is None:
            return
        if history is not None:
            missed = self._stage.recall(history, recall.edges, self._now(), over=recall.over)
            if missed:
                self.count('recalls')
                self.warn(f'{len(missed)} items were on their way when this node was not active')
            self._publish(missed)
            if recall.ended:  # what is on the belt will not get any further
                self._stage.restart(self._now())
            recall.edges.clear()
        else:
            self._publish(self._stage.end_stream(recall.over, self._now()))
        self._go_on(recall)

    def _go_on(self, recall: Recall) -> None:
        """Go on with what was kept back."""
        for edge, came in recall.edges:
            self._publish(self._stage.take(edge, came))
        for estimate in recall.estimates:
            self._take_estimate(estimate)
        self._publish(self._stage.advance(self._now()))
        self._wake()

    def _tick(self) -> None:
        """Do what time alone brings, as long as there is something to wait for."""
        now = time.monotonic_ns()
        self._ask_for_history()
        if self.parameters.deadlines:
            self._publish(self._stage.advance(now))
            self._look_after_inspections()
        strays = self._monitor.strays
        stream_time = self._stream_clock.at(now)
        if stream_time is not None:
            self._monitor.advance(stream_time)
        if self._monitor.strays > strays:
            self.count('reject_eye strays')
            self._rejector_watch.add_strays(time.monotonic(), self._monitor.strays - strays)
            self.warn('reject_eye saw something near no reject time')
        self._show_stop_request()
        self._wake()

    def _publish(self, verdicts: list[Verdict]) -> None:
        for verdict in verdicts:
            if self._numbers is not None:
                self._numbers.give(verdict.item_id)  # before anyone hears of it
            self._verdicts.send(verdict)  # before all else: the rejector waits
            self._verdict_watch.add(time.monotonic(), verdict)
            self.count(verdict.decision.name)
            if not verdict.estimate_id:
                self.count(Reason.NO_ESTIMATE)
                self.warn(f'item {verdict.item_id}: NoEstimate: {Reason.NO_ESTIMATE.hint}')
            if verdict.late:
                self.count('late verdicts')
                self.warn(f'item {verdict.item_id}: its verdict came after its reject time')
            self._monitor.add_verdict(verdict)
        if verdicts:
            self._show_stop_request()
            self._wake()

    @property
    def _request(self) -> StopRequest | None:
        """What this node asks of the line now."""
        if not self._active:
            return _NOT_READY
        waits = self._recall is not None and self._recall.overdue
        return self._monitor.request or (_NO_HISTORY if waits else None)

    def _show_stop_request(self) -> None:
        request = self._request
        if request == self._shown:
            return
        self._shown = request
        self._stop_requests.send(request)
        if request is _NOT_READY:
            self.get_logger().info(f'stop: {request.reason}: {request.reason.hint}')
        elif request is not None:
            self.count(request.reason)
            item = f'item {request.item_id}: ' if request.item_id else ''
            self.warn(f'stop: {item}{request.reason}: {request.hint}')

    def diagnose(self, now: float) -> list[Finding]:
        """Return how the verdicts, the line before this node and the rejector are."""
        known = self.parameters
        watch = self._verdict_watch
        confirmed = known.confirmation_time > 0
        no_masses = self.diagnostics.connections.lacks_input(ports.MASS_ESTIMATE)
        return [
            watch.verdicts(now, known.verdict_margin, deadlines=known.deadlines),
            watch.line(now, 'identifier' if no_masses else ''),
            self._rejector_watch.finding(now, self._monitor.request, confirmed=confirmed),
        ]

    def _reset(self, request: Any, response: Any) -> Any:
        """Clear the stop request, unless what the driver says is wrong still is."""
        cleared, shown = self._monitor.request, self._shown
        self._monitor.reset(time.time_ns())
        self._show_stop_request()
        request = self._request
        if request is not None and request == shown:
            # The driver waits to be shown what it missed since: the words may be the same.
            self._stop_requests.send(request)
        response.success = request is None
        if request is not None:
            response.message = f'{request.reason}: {request.hint}'
        else:
            response.message = 'no stop was requested' if not cleared else f'{cleared.reason} reset'
        return response


main = partial(run, partial(RejectNode, alone=True))

if __name__ == '__main__':
    main()

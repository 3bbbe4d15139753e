# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reject node: items and mass_estimate to verdict, and with reject_eye to stop_request."""

from dataclasses import replace
from functools import partial
import time
from typing import Any

from std_srvs.srv import Trigger

from checkweigher_core.health.findings import Finding
from checkweigher_core.records import (
    ExternalReject,
    Eye,
    EyeEdge,
    Item,
    LoadCell,
    MachineConditions,
    MassEstimate,
    PerformanceTest,
    ProductOnLine,
    StopRequest,
    StreamState,
    StreamStatus,
    Verdict,
)
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_core.ros import ports
from checkweigher_core.ros.managed_node import ManagedStageNode
from checkweigher_core.ros.outputs import Output
from checkweigher_core.ros.running import run
from checkweigher_dsp.health.items import RejectorWatch, VerdictWatch
from checkweigher_dsp.nodes.given_numbers import GivenNumbers, open_numbers
from checkweigher_dsp.nodes.one_shot_timer import OneShotTimer
from checkweigher_dsp.nodes.permission import PermissionGiver
from checkweigher_dsp.nodes.strangers import StrangerWatch
from checkweigher_dsp.rejection.batch_rules import BatchTally
from checkweigher_dsp.rejection.inspections import LATENESS
from checkweigher_dsp.rejection.items import MAX_JUDGED
from checkweigher_dsp.rejection.monitoring import RejectMonitor
from checkweigher_dsp.rejection.parameters import RejectParameters, limits_of
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.rejection.timing import StreamClock

_LOOK_PERIOD = 1.0  # s
_NOT_READY = StopRequest(StopReason.NOT_READY, 0)


class RejectNode(ManagedStageNode[RejectParameters]):
    """Node that gives every announced item its verdict in time for the rejector.

    While it is not active, it asks the line to stop. With `keep_numbers` or the parameter `numbers`
    it keeps the numbers of the items with a verdict in a file. The node that takes its place reads
    that file and the latched announcements, and judges the items that this one has missed.
    """

    def __init__(
        self, overrides: dict[str, object] | None = None, *, keep_numbers: bool = False
    ) -> None:
        self._numbers = GivenNumbers()  # before the parameters, which may be refused
        super().__init__(RejectParameters, overrides=overrides)
        self._verdicts = self.held_output(ports.VERDICT)
        if keep_numbers or self.parameters.numbers:
            self._numbers = open_numbers(self, self.parameters.numbers, MAX_JUDGED)
        self._stage = RejectStage(self.parameters, judged=self._numbers.numbers)
        self._monitor = RejectMonitor(self.parameters)
        self._stream_clock = StreamClock(running=self.parameters.deadlines)
        self._stream = 0
        self._active = False
        self._verdict_watch, self._rejector_watch = VerdictWatch(), RejectorWatch()
        self._stop_requests = self.output(ports.STOP_REQUEST)
        self._shown: StopRequest | None = None
        self._products = self.output(ports.PRODUCT_IN_USE)
        self._in_use: ProductOnLine | None = None  # as it was published
        # Before the estimates, so that of waiting messages the product comes first.
        self.subscribe(ports.PRODUCT_ON_LINE, self._on_product)
        self.create_service(Trigger, ports.RESET_STOP_REQUEST, self._reset)
        self._timer = OneShotTimer(self, self._tick)
        load_cell = self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        self._driver = self.subscribe(ports.DRIVER_STATUS, self._on_driver_status)
        self.subscribe(ports.ITEMS, self._on_item)
        self.subscribe(ports.SEGMENTER_STATUS, self._on_segmenter, needed=False)
        eyes = self.subscribe(ports.PHOTO_EYES, self._on_edge)
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate)
        self.subscribe(ports.REJECT_EYE, self._on_reject_eye)
        self._external = self.subscribe(ports.EXTERNAL_REJECT, self._on_external_reject)
        self._conditions = self.subscribe(ports.MACHINE_CONDITIONS, self._on_conditions)
        self._tests = self.subscribe(ports.PERFORMANCE_TEST, self._on_test)
        self._strangers = StrangerWatch(self)
        self._permission = PermissionGiver(
            self,
            {'eyes': eyes, 'load cell': load_cell},
            lambda: self._request is not None,
            deadlines=self.parameters.deadlines,
        )
        self.create_timer(_LOOK_PERIOD, self._look_around)
        self.begin()

    def start(self) -> None:
        """Activate, or request a stop."""
        super().start()
        self._show_product()
        if self.state == 'unconfigured':
            self._show_stop_request()

    def activate(self) -> None:
        """Begin to judge, and take back the request to stop."""
        self._monitor.restart()
        self._active = True
        self._stop_requests.send(self._monitor.request)
        self._shown = self._monitor.request
        self._permission.give()
        self._publish(self._stage.judge_complete(self._now()))
        self._update()

    def deactivate(self) -> None:
        """Request a stop, and reject the items on the line."""
        was_active, self._active = self._active, False
        self._show_stop_request()
        if was_active:
            self._publish(self._stage.stop(self._now()))
        self._timer.clear()

    def final_outputs(self) -> list[Output]:
        """Return the outputs of the stop request and of the verdicts."""
        return [self._stop_requests, self._verdicts]

    def destroy_node(self) -> None:
        """End the permission, destroy the node, and close the file of the numbers."""
        if hasattr(self, '_permission'):
            self._permission.end()
        super().destroy_node()
        self._numbers.close()

    def on_parameters(self) -> None:
        """Use the changed parameters."""
        self._stage.parameters = self._monitor.parameters = self.parameters
        self._stream_clock.running = self.parameters.deadlines
        self._permission.rule.deadlines = self.parameters.deadlines
        if self._stage.product.stamp:  # the limits set now hold until the next product
            self._stage.product = replace(self._stage.product, **limits_of(self.parameters))
        self._show_product()

    def _on_product(self, product: ProductOnLine) -> None:
        """Use the limits of a product, or only its counts if the product is in use."""
        in_use = self._stage.product
        if not (self.parameters.needs_product or in_use.stamp):
            self.get_logger().warning(
                'reject.needs_product is false: after its start this node accepts by the limits '
                'of its parameter file until it has those of a product'
            )
        if product.stamp == in_use.stamp:
            product = replace(in_use, **BatchTally.of(product).counts)
        else:  # so that limits which are set later are checked against these
            self.parameters = replace(self.parameters, **limits_of(product))
        self._stage.product = product
        self._show_product()

    def _show_product(self) -> None:
        """Publish the limits in use if they have changed."""
        shown = replace(self._stage.product, **BatchTally().counts)
        if shown != self._in_use:
            self._in_use = shown
            self._products.send(shown)

    def _now(self) -> int | None:
        """Return the time for the deadlines, None without deadlines."""
        return time.monotonic_ns() if self.parameters.deadlines else None

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        self.diagnostics.set_hardware(load_cell)
        self._stage.weigh_length = load_cell.weigh_length

    def _on_driver_status(self, status: StreamStatus) -> None:
        if status.stream != self._stream:
            # Edges of the first stream may have come before its first status.
            if self._stream:
                self._stage.restart()
                self._monitor.restart()
            self._stream = status.stream
        failed = 'its source failed' if status.state == StreamState.FAILED else ''
        finished = status.state == StreamState.FINISHED
        self._monitor.trouble = '' if finished else status.text or failed
        self._check()

    def _check(self) -> None:
        """Request a stop if the line, the machine or the performance test demands one."""
        self._monitor.check(time.time_ns())
        self._update()

    def _update(self) -> None:
        """Publish the stop request if it has changed, and set the timer to the next deadline."""
        if not self._active:
            return
        missed, self._stage.inspections.missed = self._stage.inspections.missed, []
        for request in missed:
            self._monitor.request = self._monitor.request or request
        self._show_stop_request()
        times = [self._stage.due] if self.parameters.deadlines else []
        if (due := self._monitor.due) is not None:
            times.append(self._stream_clock.reaches(due, time.monotonic_ns()))
        if known := [due for due in times if due is not None]:
            self._timer.set_by(min(known))
        else:
            self._timer.clear()

    def _on_edge(self, edge: EyeEdge) -> None:
        if edge.eye == Eye.OUTFEED and edge.blocked:
            self._verdict_watch.add_edge(time.monotonic(), edge.stamp)
        self._stream_clock.saw(edge.stamp, time.monotonic_ns())
        self._look_at_inspection()
        self._stage.take(edge, self._now())
        self._go_on()

    def _on_item(self, item: Item) -> None:
        late = self._stage.late_items
        self._publish(self._stage.take(item, self._now()))
        if self._stage.late_items > late:
            self.count('late items')
        self._go_on()

    def _on_segmenter(self, status: StreamStatus) -> None:
        self._permission.rule.add_progress(status, time.monotonic_ns())
        if status.stream == self._stream:
            self._stage.take(status)

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if not self._active:
            return
        late = self._stage.late_estimates
        self._publish(self._stage.take(estimate, self._now()))
        if self._stage.late_estimates > late:
            self.count('late estimates')
            self.warn(f'item {estimate.item_id}: its mass came after its verdict')
        self._go_on()

    def _go_on(self) -> None:
        """Judge the items that can wait no longer, if the node is active."""
        if not self._active:
            return
        unknown = self._stage.early.unknown
        self._publish(self._stage.advance(self._now()))
        if self._stage.early.unknown > unknown:
            self.count(Reason.UNKNOWN_ITEM)
            self.warn(f'UnknownItem: {Reason.UNKNOWN_ITEM.hint}')
        if self._stage.out_of_numbers:
            self._monitor.stop(StopReason.NO_ITEMS)
        self._update()

    def _on_reject_eye(self, edge: EyeEdge) -> None:
        self._stream_clock.saw(edge.stamp, time.monotonic_ns())
        if self._active:
            self._monitor.add_edge(edge)
            self._update()

    def _on_external_reject(self, reject: ExternalReject) -> None:
        if self._active:
            stage = self._stage
            stage.inspections.add(reject, stage.weigh_length, time.monotonic_ns())
            self.count('external rejects')
            self._update()

    def _on_conditions(self, conditions: MachineConditions) -> None:
        self._monitor.conditions = conditions
        self._look_at_inspection()
        self._check()

    def _look_at_inspection(self) -> None:
        """Check that the inspection devices run, and that a node publishes their rejects."""
        stamp = self._stream_clock.at(time.monotonic_ns())
        if stamp is None or not self.parameters.devices:
            return
        known = self._monitor.conditions
        running = known.known and StopReason.INSPECTION_FAULT not in known.conditions
        heard = running and self._external.count() > 0
        # An outage may have begun before the latest edges.
        self._stage.inspections.set_running(heard, stamp if heard else stamp - LATENESS)

    def _on_test(self, test: PerformanceTest) -> None:
        self._monitor.test = test
        self._check()

    def _look_around(self) -> None:
        """Check for strangers, the inspection devices, and the end of a grace period."""
        self._look_for_strangers()
        self._look_at_inspection()
        self._check()

    def _look_for_strangers(self) -> None:
        self._strangers.look()
        self._stage.foreign = bool(self._strangers.found)
        self._monitor.strangers = self._strangers.found

    def _tick(self) -> None:
        """Judge by the time that has passed."""
        if self.parameters.deadlines:
            self._go_on()
        strays = self._monitor.strays
        stream_time = self._stream_clock.at(time.monotonic_ns())
        if stream_time is not None:
            self._monitor.advance(stream_time)
        if self._monitor.strays > strays:
            self.count('reject_eye strays')
            self._rejector_watch.add_strays(time.monotonic(), self._monitor.strays - strays)
            self.warn('reject_eye saw something near no reject time')
        self._update()

    def _publish(self, verdicts: list[Verdict]) -> None:
        items = self._stage.items
        passed_over, items.passed_over = items.passed_over, []
        for number in passed_over:
            self._numbers.give(number)
        for verdict in verdicts:
            self._numbers.give(
                verdict.item_id
            )  # before it is published, so that none is given twice
            self._verdicts.send(verdict)  # before all else, because the rejector waits
            self._verdict_watch.add(time.monotonic(), verdict)
            self.count(verdict.decision.name)
            if not verdict.estimate_id:
                self.count(Reason.NO_ESTIMATE)
                self.warn(f'item {verdict.item_id}: NoEstimate: {Reason.NO_ESTIMATE.hint}')
            if verdict.late:
                self.count('late verdicts')
                self.warn(f'item {verdict.item_id}: its verdict came after its reject time')
            self._monitor.add_verdict(verdict)

    @property
    def _request(self) -> StopRequest | None:
        """Stop request of this node, None if the line may run."""
        return self._monitor.request if self._active else _NOT_READY

    def _show_stop_request(self) -> None:
        request = self._request
        if request == self._shown:
            return
        self._shown = request
        self._stop_requests.send(request)
        self._permission.give()
        if request is _NOT_READY:
            self.get_logger().info(f'stop: {request.reason}: {request.reason.hint}')
        elif request is not None:
            self.count(request.reason)
            item = f'item {request.item_id}: ' if request.item_id else ''
            self.warn(f'stop: {item}{request.reason}: {request.hint}')

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on the verdicts, the line before this node, and the rejector."""
        known = self.parameters
        watch = self._verdict_watch
        confirmed = known.confirmation_time > 0
        no_masses = self.diagnostics.connections.lacks_input(ports.MASS_ESTIMATE)
        return [
            watch.verdicts(now, known.verdict_margin, deadlines=known.deadlines),
            watch.line(now, 'identifier' if no_masses else ''),
            self._rejector_watch.finding(now, self._monitor.request, confirmed=confirmed),
            self._strangers.finding(),
            self._permission.rule.finding(),
        ]

    def _reset(self, request: Any, response: Any) -> Any:
        """Clear the stop request, unless a reason for it lasts."""
        cleared, shown = self._monitor.request, self._shown
        self._look_for_strangers()
        # The last message of a publisher that has gone does not count.
        if not self._driver.count():
            self._monitor.trouble = ''
        if not self._conditions.count():
            self._monitor.conditions = MachineConditions(0, True)
        if not self._tests.count():
            self._monitor.test = None
        self._stage.out_of_numbers = False
        self._monitor.reset(time.time_ns())
        self._show_stop_request()
        request = self._request
        if request is not None and request == shown:
            # Again, because the driver waits for an answer to the reset.
            self._stop_requests.send(request)
        response.success = request is None
        if request is not None:
            response.message = f'{request.reason}: {request.hint}'
        elif cleared is not None:
            response.message = f'{cleared.reason} reset'
        else:
            response.message = 'no stop was requested'
        return response


main = partial(run, partial(RejectNode, keep_numbers=True))

if __name__ == '__main__':
    main()

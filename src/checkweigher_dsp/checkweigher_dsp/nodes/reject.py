# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node reject, which converts items and mass_estimate to verdict and stop_request."""

from functools import partial
import time

from checkweigher_core.health.findings import Finding
from checkweigher_core.records import (
    ExternalReject,
    Eye,
    EyeEdge,
    Item,
    LoadCell,
    MassEstimate,
    StreamStatus,
)
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_core.ros import ports
from checkweigher_core.ros.managed_node import ManagedStageNode
from checkweigher_core.ros.outputs import Output
from checkweigher_core.ros.running import run
from checkweigher_dsp.health.items import RejectorWatch
from checkweigher_dsp.nodes.deadline_timer import DeadlineTimer
from checkweigher_dsp.nodes.given_numbers import GivenNumbers, open_numbers
from checkweigher_dsp.nodes.permission import PermissionGiver
from checkweigher_dsp.nodes.product_in_use import ProductInUse
from checkweigher_dsp.nodes.stop_requests import StopRequests
from checkweigher_dsp.nodes.verdict_output import VerdictOutput
from checkweigher_dsp.rejection.items import MAX_JUDGED
from checkweigher_dsp.rejection.limits import tolerance
from checkweigher_dsp.rejection.monitoring import RejectMonitor
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage


class RejectNode(ManagedStageNode[RejectParameters]):
    """Node that publishes the verdict on each announced item in time for the rejector.

    The segmenter announces an item by a message on the topic `items`. The node requests a stop of
    the line while it is not active. With `keep_numbers` or the parameter `numbers`, the node stores
    the numbers of items with a verdict in a file. The next process of the node reads this file and
    the latched announcements, and publishes the missing verdicts.
    """

    def __init__(
        self, overrides: dict[str, object] | None = None, *, keep_numbers: bool = False
    ) -> None:
        # Set `_numbers` first, because `destroy_node` needs it even if a parameter is invalid.
        self._numbers = GivenNumbers()
        super().__init__(RejectParameters, overrides=overrides)
        if keep_numbers or self.parameters.numbers:
            self._numbers = open_numbers(self, self.parameters.numbers, MAX_JUDGED)
        self._stage = RejectStage(self.parameters, judged=self._numbers.numbers)
        self._monitor, self._rejector_watch = RejectMonitor(self.parameters), RejectorWatch()
        self._verdicts = VerdictOutput(
            self, self._numbers, self._stage.items, self._monitor.add_verdict
        )
        self._timer = DeadlineTimer(self, self._tick, running=self.parameters.deadlines)
        self._stream = 0
        # Subscribe to the product first, so that a waiting product is processed before estimates.
        self._product = ProductInUse(self, self._stage)
        load_cell = self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        driver = self.subscribe(ports.DRIVER_STATUS, self._on_driver_status)
        self.subscribe(ports.ITEMS, self._on_record)
        self.subscribe(ports.SEGMENTER_STATUS, self._on_segmenter, needed=False)
        eyes = self.subscribe(ports.PHOTO_EYES, self._on_edge)
        self.subscribe(ports.MASS_ESTIMATE, self._on_record)
        self.subscribe(ports.ZERO_SETTING, self._monitor.add_zero_change, needed=False)
        self.subscribe(ports.REJECT_EYE, self._on_reject_eye)
        self._external = self.subscribe(ports.EXTERNAL_REJECT, self._on_external_reject)
        self._stops = StopRequests(
            self, self._monitor, driver, self._update, lambda: self._permission.give()
        )
        self._permission = PermissionGiver(
            self,
            {'eyes': eyes, 'load cell': load_cell},
            lambda: self._stops.request is not None,
            deadlines=self.parameters.deadlines,
        )
        self.begin()

    def start(self) -> None:
        """Activate the node if ``autostart`` is true, otherwise request a stop."""
        super().start()
        self._product.show()
        if self.state == 'unconfigured':
            self._stops.show()

    def activate(self) -> None:
        """Begin to publish verdicts, and replace the stop request NotReady.

        The request NotReady is replaced by the request of the monitor, or withdrawn if the monitor
        requests no stop. A complete item gets its verdict without waiting for its mass, because the
        node may have missed this mass while it was not active.
        """
        self._monitor.restart()
        self._stops.begin()
        self._verdicts.send(self._stage.judge_complete(self._timer.now))
        self._update()

    def deactivate(self) -> None:
        """Request a stop, and publish the verdicts on all items without awaiting their masses.

        If the node was not active, no verdicts are published.
        """
        was_active = self._stops.active
        self._stops.end()
        if was_active:
            self._verdicts.send(self._stage.stop(self._timer.now))
        self._timer.set(None, None)

    def final_outputs(self) -> list[Output]:
        """Return the outputs of the stop request and of the verdicts."""
        return [self._stops.output, self._verdicts.output]

    def destroy_node(self) -> None:
        """Destroy the node and close its file of item numbers."""
        super().destroy_node()
        self._numbers.close()

    def on_parameters(self) -> None:
        """Apply changed parameters."""
        self._stage.parameters = self._monitor.parameters = self.parameters
        self._timer.clock.running = self._permission.rule.deadlines = self.parameters.deadlines
        self._product.use_parameters()

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        self.diagnostics.set_hardware(load_cell)
        self._stage.weigh_length = load_cell.weigh_length

    def _on_driver_status(self, status: StreamStatus) -> None:
        if status.stream != self._stream:
            # Keep the edges of the first stream, which may arrive before its first status.
            if self._stream:
                self._stage.restart()
                self._monitor.restart()
            self._stream = status.stream
        self._stops.add_status(status)

    def _on_edge(self, edge: EyeEdge) -> None:
        if edge.eye == Eye.OUTFEED and edge.blocked:
            self._verdicts.add_edge(edge.stamp)
        self._timer.saw(edge.stamp)
        self._stage.take(edge, self._timer.now)
        self._go_on()

    def _on_record(self, record: Item | MassEstimate) -> None:
        """Add an announcement, or an estimate if the node is active, and publish due verdicts."""
        stage = self._stage
        if isinstance(record, MassEstimate):
            if not self._stops.active:
                return
            self._monitor.add_zero(record, tolerance(stage.product))
        late_items, late_estimates = stage.late_items, stage.late_estimates
        self._verdicts.send(stage.take(record, self._timer.now))
        if stage.late_items > late_items:
            self.count('late items')
        if stage.late_estimates > late_estimates:
            self.count('late estimates')
            self.warn(f'item {record.item_id}: its mass came after its verdict')
        self._go_on()

    def _on_segmenter(self, status: StreamStatus) -> None:
        self._permission.rule.add_progress(status, time.monotonic_ns())
        if status.stream == self._stream:
            self._stage.take(status)

    def _on_reject_eye(self, edge: EyeEdge) -> None:
        self._timer.saw(edge.stamp)
        if self._stops.active:
            self._monitor.add_edge(edge)
            self._update()

    def _on_external_reject(self, reject: ExternalReject) -> None:
        if self._stops.active:
            weigh_length = self._stage.weigh_length
            self._stage.inspections.add(reject, weigh_length, time.monotonic_ns())
            self.count('external rejects')
            self._update()

    def _go_on(self) -> None:
        """If the node is active, publish the verdicts that are due."""
        if not self._stops.active:
            return
        unknown = self._stage.early.unknown
        self._verdicts.send(self._stage.advance(self._timer.now))
        if self._stage.early.unknown > unknown:
            self.count(Reason.UNKNOWN_ITEM)
            self.warn(f'UnknownItem: {Reason.UNKNOWN_ITEM.hint}')
        self._update()

    def _tick(self) -> None:
        """Publish the verdicts that are due, and evaluate the eye behind the rejector."""
        self._go_on()
        stamp = self._timer.stamp
        if stamp is not None and (strays := self._monitor.advance(stamp)):
            self.count('reject_eye strays')
            self._rejector_watch.add_strays(time.monotonic(), strays)
            self.warn('reject_eye saw an object that matches no reject time')
        self._update()

    def _update(self) -> None:
        """Pass the reasons for a stop to the monitor, publish its request, and set the timer.

        The stage also receives whether there are foreign nodes, and the state of the inspection
        devices. If the node is not active, no request is published and the timer is not set.
        """
        stage, monitor = self._stage, self._monitor
        stage.foreign = bool(monitor.strangers)
        stamp = self._timer.stamp
        if stamp is not None and self.parameters.devices:
            stage.inspections.look(monitor.conditions, stamp, heard=self._external.count() > 0)
        if not self._stops.active:
            return
        if stage.out_of_numbers:
            stage.out_of_numbers = False
            monitor.stop(StopReason.NO_ITEMS)
        monitor.request = monitor.request or stage.inspections.missed
        stage.inspections.missed = None
        self._stops.show()
        self._timer.set(stage.due, monitor.due)

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on verdicts, rejector, publishers and permission."""
        confirmed = self.parameters.confirmation_time > 0
        return [
            *self._verdicts.findings(now),
            self._rejector_watch.finding(now, self._monitor.request, confirmed=confirmed),
            self._stops.strangers.finding(),
            self._permission.rule.finding(),
        ]


main = partial(run, partial(RejectNode, keep_numbers=True))

if __name__ == '__main__':
    main()

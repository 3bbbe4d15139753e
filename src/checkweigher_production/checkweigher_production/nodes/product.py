# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node that manages recipes, batches, production statistics, alarms and the audit log."""

from collections.abc import Awaitable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from checkweigher_msgs.srv import BeginTest, NewBatch, RecordChange, ResetStatistics, SelectProduct
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from std_srvs.srv import Trigger

from checkweigher_core.health.disk import DiskWatch, free_bytes
from checkweigher_core.health.findings import Finding
from checkweigher_core.health.host_clock import HostClock
from checkweigher_core.parameters import ParameterError, Parameters, SettingsError, parameter
from checkweigher_core.records import LoadCell, MassEstimate, Statistics, StopRequest, Verdict, utc
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.line_parameters import (
    LineNodes,
    LineParametersClient,
    RefusedError,
    Values,
)
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.rejection.parameters import limits_of
from checkweigher_production.alarms import AlarmList
from checkweigher_production.audit_chain import name_predecessor
from checkweigher_production.audit_log import AuditError, AuditLog
from checkweigher_production.batch_record import RecordError
from checkweigher_production.nodes.batch_recorder import LineBatches
from checkweigher_production.nodes.line_audit import LineAudit
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.nodes.line_selection import LineSelection, find
from checkweigher_production.nodes.performance import LineTest

_PATIENCE = 2.0  # longest wait in s for an answer of another node
_POLL_PERIOD = 0.5  # period in s of the timers for recipes, records and parameters
_NOTE_PERIOD = 3600.0  # time in s between two audit log entries on the state of the batch record


@dataclass(frozen=True)
class ProductParameters(Parameters):
    """Parameters of the product node."""

    node: ClassVar[str] = 'product'

    recipes: str = parameter('', 'recipe file; empty for none')
    product: str = parameter('', 'product at a start without a stored selection; empty for none')
    batch: str = parameter('', 'name of the batch at a start without a stored selection')
    audit_log: str = parameter('', 'file to which changes are appended; empty for none')
    batch_folder: str = parameter(
        '',
        'folder for the record of each batch, and for the selection of product and batch, which is '
        'restored after a restart; empty for none',
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.batch_folder and not self.recipes:
            raise ParameterError('product.batch_folder: needs recipes; set product.recipes')


class ProductNode(StageNode[ProductParameters]):
    """Node that manages recipes, batches, production statistics, alarms and the audit log."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        # Created first, because `destroy_node` closes it even if the rest of this method fails.
        self._files = ExitStack()
        super().__init__(ProductParameters, read_only=True, overrides=overrides)
        known, name = self.parameters, self.get_fully_qualified_name()
        self._host_clock = HostClock()
        kept = Path(known.audit_log or known.batch_folder).absolute().parent
        self._disk = DiskWatch(partial(free_bytes, kept))
        try:
            if known.product:
                find(known.recipes, known.product)
            log = self._opened_log()
            self._batches = LineBatches(known.batch, known.batch_folder, self._time, log)
        except (AuditError, SettingsError, RecordError) as error:
            self.destroy_node()
            raise ParameterError(str(error)) from None
        self._started_nodes = LineNodes(self)
        line = LineParametersClient(self, _PATIENCE)
        self._audit = LineAudit(
            log, name, self._time, line, self._batches.has_record, self.warn, self._limits
        )
        self._trail = self._audit.trail
        self._batches.open(self._audit.write_state)
        self._files.callback(self._close_records)
        self._alarms = AlarmList(self._trail, self._stamp, self.output(ports.ALARMS).send)
        self._alarms.begin_run()
        self._files.callback(self._alarms.end_run)
        publish, tally = self.output(ports.PRODUCT_ON_LINE).send, self._batches.production.tally
        self._recipe = LineRecipe(line, publish, self._stamp, tally)
        tests = self.output(ports.PERFORMANCE_TEST)
        self._test = LineTest(self._recipe, self._trail, tests.send, self._stamp)
        parts = self._recipe, self._batches, self._audit, self._test
        self._selection = LineSelection(known.recipes, known.product, *parts, self.warn)
        self._statistics = self.output(ports.STATISTICS)
        self._feedback = self.output(ports.FILLER_FEEDBACK)
        self._results = self.output(ports.BATCH_RESULT)
        # If batches are recorded, use the latched QoS of the verdicts, because the verdicts that
        # are published while this node restarts must be recorded as well.
        latched = ports.VERDICT.qos if known.batch_folder else None
        self.subscribe(ports.VERDICT, self._on_verdict, qos=latched)
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate)
        self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        self._serve()
        self.subscribe(ports.STOP_REQUEST, self._on_stop_request)
        if known.batch_folder:
            self.create_timer(_POLL_PERIOD, self._advance_records)
            self.create_timer(_NOTE_PERIOD, self._batches.note)
        if known.audit_log:
            self._audit_others()

    def _limits(self) -> Values:
        """Return the limits that the reject node uses, or {} before it has confirmed them."""
        return {} if self._recipe.in_use is None else limits_of(self._recipe.in_use)

    def _opened_log(self) -> AuditLog | None:
        """Open the audit log and return it, or return None if no log is wanted.

        `destroy_node` closes the log. Raises `AuditError` if the log cannot be used.
        """
        if not self.parameters.audit_log:
            if self.parameters.recipes:
                self.get_logger().warning('product.audit_log is empty: no change is written down')
            return None
        log = self._files.enter_context(AuditLog(Path(self.parameters.audit_log)))
        name_predecessor(log, self._time(), self.get_fully_qualified_name())
        return log

    def _serve(self) -> None:
        """Create the services, and the timer of the recipes."""
        # The callbacks are in one group, because otherwise a second one could begin while the first
        # one awaits other nodes.
        group = MutuallyExclusiveCallbackGroup()
        for kind, name, callback in (
            (SelectProduct, ports.SELECT_PRODUCT, self._on_select),
            (NewBatch, ports.NEW_BATCH, self._on_new_batch),
            (ResetStatistics, ports.RESET_STATISTICS, self._on_reset),
            (BeginTest, ports.BEGIN_TEST, self._on_begin_test),
            (Trigger, ports.ACKNOWLEDGE_ALARMS, self._on_acknowledge),
        ):
            self.create_service(kind, name, callback, callback_group=group)
        if self.parameters.recipes:
            self.subscribe(ports.PRODUCT_IN_USE, self._selection.taken)
            self.create_timer(_POLL_PERIOD, self._advance_recipe, callback_group=group)

    def _audit_others(self) -> None:
        """Create the service, the subscription and the timer that log changes of other nodes."""
        self.create_service(RecordChange, ports.RECORD_CHANGE, self._audit.on_change)
        self.subscribe(ports.ZERO_SETTING, self._audit.on_zero_setting)
        own_group = MutuallyExclusiveCallbackGroup()
        self.create_timer(_POLL_PERIOD, self._read_started, callback_group=own_group)

    def destroy_node(self) -> None:
        """Close the log and the batch record, then destroy the node."""
        self._files.close()
        super().destroy_node()

    def _stamp(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _time(self) -> str:
        return utc(self._stamp())

    async def _answer(self, response: Any, work: Awaitable[Any], failed: str) -> str:
        """Await the work of a service, and return the message of its response.

        `work` returns a message, None, or the statistics of a finished batch. Statistics are added
        to `response`. The message of the response is empty unless `work` returns a message. If
        `work` fails, a warning that begins with `failed` is logged, and ValueError is raised.
        """
        try:
            made = await work
        except (RefusedError, ValueError) as error:
            self.warn(f'{failed}: {error}')
            raise ValueError(str(error)) from None
        if isinstance(made, str):
            return made
        if isinstance(made, Statistics):
            response.finished = to_message(ports.STATISTICS, made)
        self._publish()
        return ''

    async def _on_select(self, request: Any, response: Any) -> str:
        self._add_started()
        work = self._selection.select(request.product, self._audit.author_of(ports.SELECT_PRODUCT))
        return await self._answer(response, work, f'product {request.product!r} was not selected')

    async def _on_new_batch(self, request: Any, response: Any) -> str:
        name = str(request.batch).strip()
        work = self._selection.begin_batch(name, self._audit.author_of(ports.NEW_BATCH))
        return await self._answer(response, work, 'no new batch')

    async def _on_reset(self, request: Any, response: Any) -> str:
        work = self._selection.reset_counts(self._audit.author_of(ports.RESET_STATISTICS))
        return await self._answer(response, work, 'statistics')

    async def _on_begin_test(self, request: Any, response: Any) -> str:
        begin_or_cancel = self._test.cancel if request.cancel else self._test.begin
        author = self._audit.claimed_by(ports.BEGIN_TEST, request.who, request.reason)
        return await self._answer(response, begin_or_cancel(author), 'performance test')

    async def _advance_recipe(self) -> None:
        """Select the product at the start of the line, and update the performance test.

        In nodes that were restarted, set the parameters of the product again.
        """
        self._add_started()
        if await self._selection.select_at_start():
            self._publish()
        await self._selection.restore()
        try:
            await self._test.advance()
        except (AuditError, RefusedError) as error:
            self.warn(f'performance test: {error}')

    def _on_verdict(self, verdict: Verdict) -> None:
        if not self._batches.add(verdict):
            return
        self._recipe.update()
        self._publish()
        self._test.take(verdict)
        self._trail.verdict(verdict)
        self._alarms.add_verdict(verdict)
        if feedback := self._batches.feedback(verdict):
            self._feedback.send(feedback)

    def _close_records(self) -> None:
        """Close the record of the batch, and write its hash to the audit log."""
        self._batches.close()
        for state in self._batches.states():
            self._audit.write_state(state)

    def _advance_records(self) -> None:
        """Publish the results of ended batches.

        If an earlier attempt to save product and batch has failed, save them again.
        """
        for ended in self._selection.ended_batches():
            self._results.send(replace(ended, stamp=self._stamp()))
        if self._batches.not_kept:
            self._batches.keep(self._recipe.selected)

    def _add_started(self) -> None:
        started = self._started_nodes.started()
        self._recipe.add_started(started)
        self._audit.add_started(started)
        self._alarms.add_started(started)

    def _on_acknowledge(self, request: Any, response: Any) -> str:
        return self._alarms.acknowledge(self._audit.author_of(ports.ACKNOWLEDGE_ALARMS))

    def _on_stop_request(self, request: StopRequest | None) -> None:
        self._alarms.set_stop(request)
        if request is not None and self.parameters.batch_folder:
            self._batches.write('stop', {'time': self._time(), **asdict(request)})

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        self._batches.production.begin_stream()
        self._audit.on_load_cell(load_cell)

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if self._batches.production.current.add_estimate(estimate):
            self.warn(f'item {estimate.item_id}: length or belt speed is not that of the product')

    def _publish(self) -> None:
        self._statistics.send(self._batches.production.summary())

    async def _read_started(self) -> None:
        self._add_started()
        self._audit.watch_clock(self._host_clock.reference)
        await self._audit.read_started()

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on recipe, audit log, alarms, batch record, test, clock and disk."""
        return [
            self._selection.finding(),
            self._audit.finding(),
            self._alarms.finding(),
            self._batches.finding(),
            self._test.finding(),
            self._host_clock.finding(now),
            self._disk.finding(now),
        ]


main = partial(run, ProductNode)

if __name__ == '__main__':
    main()

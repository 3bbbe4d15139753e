# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The product node: recipes of the line, statistics of production, and the audit log."""

from collections.abc import Awaitable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from checkweigher_msgs.srv import BeginTest, NewBatch, RecordChange, ResetStatistics, SelectProduct
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from checkweigher_core import changes
from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.health.host_clock import HostClock
from checkweigher_core.parameters import ParameterError, Parameters, SettingsError, parameter
from checkweigher_core.printable import one_line
from checkweigher_core.records import (
    NANOSECONDS,
    BatchResult,
    LoadCell,
    MassEstimate,
    ProductOnLine,
    StopRequest,
    Verdict,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.line_parameters import (
    LineNodes,
    LineParametersClient,
    RefusedError,
)
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_core.settings_files import plain
from checkweigher_dsp.rejection.parameters import limits_of
from checkweigher_production.audit_log import AuditError, AuditLog
from checkweigher_production.authors import Author
from checkweigher_production.batch_record import RecordError
from checkweigher_production.filler_feedback import FillerController
from checkweigher_production.nodes.batch_recorder import BatchRecorder
from checkweigher_production.nodes.line_audit import LineAudit
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.nodes.performance import LineTest
from checkweigher_production.recipes import NODES, Product, read_recipes
from checkweigher_production.statistics import ProductionRecord

_PATIENCE = 2.0  # s, for an answer of another node
_POLL_PERIOD = 0.5  # s
# Statistics that the audit log keeps.
_AUDITED = ('product', 'batch', 'items', 'accepted', 'under', 'over', 'faults', 'mean', 'std_dev')


@dataclass(frozen=True)
class ProductParameters(Parameters):
    """The recipe file, and the product on the line at the start."""

    node: ClassVar[str] = 'product'

    recipes: str = parameter('', 'recipe file; empty for none')
    product: str = parameter('', 'product that is selected at the start; empty for none')
    batch: str = parameter('', 'name of the batch at the start')
    audit_log: str = parameter('', 'file to which changes are appended; empty for none')
    batch_folder: str = parameter(
        '', 'folder for the record of each batch, which goes on after a restart; empty for none'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.batch_folder and not self.recipes:
            raise ParameterError('product.batch_folder: needs recipes, which have the batches')


class ProductNode(StageNode[ProductParameters]):
    """Select the product, count the items, and write down what is changed."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        self._log: AuditLog | None = None  # before the parameters, which may be refused
        self._record: BatchRecorder | None = None
        super().__init__(ProductParameters, read_only=True, overrides=overrides)
        self._production = ProductionRecord(self.parameters.batch)
        self._host_clock = HostClock()
        self._filler: FillerController | None = None
        try:
            self._open_files()
        except (AuditError, SettingsError, RecordError) as error:
            self.destroy_node()
            raise ParameterError(str(error)) from None
        self._started_nodes = LineNodes(self)
        line = LineParametersClient(self, _PATIENCE)
        name = self.get_fully_qualified_name()
        self._audit = LineAudit(self._log, name, self._time, line, self._has_record, self.warn)
        self._trail = self._audit.trail
        self._by = Author()  # who has asked for what is being changed
        self._recipe = LineRecipe(
            line, lambda changes: self._audit.announce(changes, self._by),
            self.output(ports.PRODUCT_ON_LINE).send, self._stamp, self._production.tally,
        )  # fmt: skip
        tests = self.output(ports.PERFORMANCE_TEST)
        self._test = LineTest(self._recipe, self._trail, tests.send, self._stamp)
        self._statistics = self.output(ports.STATISTICS)
        self._feedback = self.output(ports.FILLER_FEEDBACK)
        self._results = self.output(ports.BATCH_RESULT)
        self.subscribe(
            ports.VERDICT, self._on_verdict,
            # With a record also those that were missed while this node was away.
            qos=ports.VERDICT.qos if self.parameters.batch_folder else None,
        )  # fmt: skip
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate)
        self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        self._serve()
        if self.parameters.batch_folder:
            self.subscribe(ports.STOP_REQUEST, self._on_stop_request)
            self.create_timer(_POLL_PERIOD, self._tell_ended)
        if self.parameters.audit_log:
            self._audit_others()

    def _open_files(self) -> None:
        if self.parameters.product:
            self._find(self.parameters.product)
        if self.parameters.audit_log:
            self._log = AuditLog(Path(self.parameters.audit_log))
        elif self.parameters.recipes:
            self.get_logger().warning('product.audit_log is empty: no change is written down')
        if self.parameters.batch_folder:
            self._record = self._begin_record(Path(self.parameters.batch_folder))

    def _serve(self) -> None:
        """Offer the services, and look after what the recipes ask for."""
        # One service at a time, for each waits for other nodes of the line.
        group = MutuallyExclusiveCallbackGroup()
        for kind, name, callback in (
            (SelectProduct, ports.SELECT_PRODUCT, self._on_select),
            (NewBatch, ports.NEW_BATCH, self._on_new_batch),
            (ResetStatistics, ports.RESET_STATISTICS, self._on_reset),
            (BeginTest, ports.BEGIN_TEST, self._on_begin_test),
        ):
            self.create_service(kind, name, callback, callback_group=group)
        if self.parameters.recipes:
            self.subscribe(ports.PRODUCT_IN_USE, self._recipe.taken)
            poll = partial(self.create_timer, _POLL_PERIOD, callback_group=group)
            self._start_timer = poll(self._select_at_start)
            poll(self._restore)
            poll(self._look_after_test)

    def _audit_others(self) -> None:
        """Write down what other nodes of the line change."""
        self.create_service(RecordChange, ports.RECORD_CHANGE, self._audit.on_change)
        self.subscribe(ports.ZERO_SETTING, self._audit.on_zero_setting)
        own_group = MutuallyExclusiveCallbackGroup()
        self.create_timer(_POLL_PERIOD, self._read_started, callback_group=own_group)

    def destroy_node(self) -> None:
        """Close log and record as well."""
        if self._record is not None:
            self._record.close()
            self._record = None
        if self._log is not None:
            self._log.close()
            self._log = None
        super().destroy_node()

    def _stamp(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _time(self) -> str:
        seconds = self._stamp() / NANOSECONDS
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec='microseconds')

    def _begin_record(self, folder: Path) -> BatchRecorder:
        audit = {}
        if self._log is not None:
            audit = {'audit_log': str(self._log.path), 'audit_hash': self._log.last_hash}
        return BatchRecorder(folder, self._production, self._time(), audit)

    def _notice_started(self) -> None:
        started = self._started_nodes.started()
        self._recipe.add_started(started)
        self._audit.parameters.add_started(started)

    # Recipes

    def _find(self, name: str) -> tuple[dict[str, Product], Product]:
        path = self.parameters.recipes
        if not path:
            raise SettingsError('the parameter recipes of the node product names no file')
        products = read_recipes(Path(path))
        if name not in products:
            raise SettingsError(f'{path}: has no product {name!r}; it has {", ".join(products)}')
        return products, products[name]

    async def _answer(self, response: Any, work: Awaitable[object], failed: str) -> Any:
        """Return the response of a service to some work; `failed` begins the warning."""
        try:
            await work
            response.success = True
        except (AuditError, RefusedError, ValueError) as error:
            response.message = str(error)
            self.warn(f'{failed}: {error}')
        return response

    async def _on_select(self, request: Any, response: Any) -> Any:
        self._by = self._audit.author_of(ports.SELECT_PRODUCT)
        failed = f'product {request.product!r} was not selected'
        return await self._answer(response, self._select(request.product), failed)

    async def _select(self, name: str) -> None:
        products, product = self._find(name)
        self._notice_started()
        self._trail.recipes(plain(products), self._by)
        # Written before it is done: a change that cannot be written down is not made.
        before, batch = self._production.product, self._production.batch
        old, new = map(_audited, (self._recipe.in_use, product.on_line(batch)))
        self._trail.note(changes.SELECTION, 'product', old, new, self._by)
        # Items that are judged by the new recipe while it is set belong to it already.
        self._use(product)
        try:
            await self._recipe.set(product, batch)
        except RefusedError as error:
            self._use(before if self._recipe.on_line.product else None)
            self._trail.saw(changes.REFUSED, 'product', name, str(error), self._by)
            raise
        self._control_filler(product)
        self._test.select(product, batch)
        self.count('products selected')
        self._publish()

    def _use(self, product: Product | None) -> None:
        """Count for a product from now on."""
        self._production.product = product
        if self._record is not None and product is not None:
            self._record.write('product', {'name': product.name, **plain(product)})

    def _control_filler(self, product: Product) -> None:
        """Begin to control the filler for a product, or go on if it is the same one."""
        filler, correction = product.filler, 0.0
        if self._filler is not None and self._filler.product == product.name:
            correction = self._filler.correction
        elif self._filler is None and self._record and self._record.product == product.name:
            correction = self._record.correction
        self._filler = None
        if filler is not None:
            of_product = product.name, product.nominal, product.tare
            self._filler = FillerController(filler, *of_product, correction)

    async def _select_at_start(self) -> None:
        self._by = Author()
        name = self.parameters.product
        if not self._recipe.ready:
            if name:
                self.warn(f'product {name!r} waits for the nodes of the line')
            return
        if self._audit.awaits(set(NODES)):
            return
        try:
            if self._production.product is None:
                # If only this node was started again, the product on the line stays.
                name = self._recipe.on_line.product or name
                if name:  # otherwise the limits of the line hold
                    await self._select(name)
            self._start_timer.cancel()
        except (AuditError, SettingsError, RefusedError) as error:
            self.warn(f'product {name!r} was not selected: {error}')

    async def _restore(self) -> None:
        """Give nodes of the line that were started again the parameters of the product."""
        self._by = Author()
        self._notice_started()
        lost = self._recipe.lost
        if not lost or self._audit.awaits(lost):
            return
        try:
            product = await self._recipe.restore()
            for node in sorted(lost):
                self.warn(f'{node} was started again: it has the parameters of {product!r} again')
                self._trail.saw(changes.RESTORED, node, None, product)
        except RefusedError as error:
            self.warn(f'{", ".join(sorted(lost))}: started again, without the product: {error}')

    # Statistics

    def _on_verdict(self, verdict: Verdict) -> None:
        if not self._production.add(verdict):
            return  # it came before this node was started again
        self._recipe.update()
        if self._record is not None:
            self._record.write('verdict', verdict)
        self._publish()
        self._test.take(verdict)
        self._trail.verdict(verdict)
        if self._filler and (feedback := self._filler.add(verdict)):
            self._feedback.send(feedback)
            if self._record is not None:
                self._record.write('filler', feedback)

    def _on_stop_request(self, request: StopRequest | None) -> None:
        if self._record is not None and request is not None:
            self._record.write('stop', {'time': self._time(), **asdict(request)})

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        """Take note of a stream that begins."""
        self._production.begin_stream()
        if self._log is not None:
            self._audit.on_load_cell(load_cell)

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if self._production.current.add_estimate(estimate):
            self.warn(f'item {estimate.item_id}: length or belt speed is not that of the product')

    def _publish(self) -> None:
        self._statistics.send(self._production.summary())

    async def _on_new_batch(self, request: Any, response: Any) -> Any:
        self._by = self._audit.author_of(ports.NEW_BATCH)
        name = str(request.batch).strip()
        if not name or self._production.has_batch(name) or self._has_record(name):
            response.message = f'batch {name!r}: a name that was not used before is needed'
            return response
        work = self._end_count(response, changes.BATCH, name)
        return await self._answer(response, work, f'batch {name!r}')

    async def _on_reset(self, request: Any, response: Any) -> Any:
        self._by = self._audit.author_of(ports.RESET_STATISTICS)
        work = self._end_count(response, changes.RESET, None)
        return await self._answer(response, work, 'statistics')

    async def _end_count(self, response: Any, kind: str, batch: str | None) -> None:
        finished = self._production.summary()
        audited = {name: getattr(finished, name) for name in _AUDITED}
        self._trail.note(kind, 'statistics', audited, batch, self._by)
        if batch is None:
            self._production.reset()
            if self._record is not None:
                self._record.write('reset', {'time': self._time()})
        else:
            await self._change_batch(batch)
        response.finished = to_message(ports.STATISTICS, finished)
        self._publish()

    async def _change_batch(self, batch: str) -> None:
        """Have the reject node count for another batch, then end the record of this one."""
        before, self._production.batch = self._production.batch, batch
        try:
            await self._recipe.change(batch=batch)
        except (AuditError, RefusedError) as error:
            self._production.batch = before
            self._trail.saw(changes.REFUSED, 'batch', batch, str(error), self._by)
            raise
        product = self._production.product
        if self._record is not None:
            self._record.change(batch, self._time())
            if product is not None:
                self._use(product)
        if product is not None:
            self._test.select(product, batch)

    def _tell_ended(self) -> None:
        """Tell of records that are complete, once the audit log has their hashes."""
        while self._record is not None and not self._record.ended.empty():
            ended = self._record.ended.get()
            self._trail.saw_state(changes.RECORD, ended.batch, ended.sha256)
            path = str(ended.path.resolve())
            self._results.send(BatchResult(self._stamp(), ended.batch, path, ended.sha256))

    # Performance test

    async def _on_begin_test(self, request: Any, response: Any) -> Any:
        who, reason = one_line(request.who), one_line(request.reason)
        self._by = Author(who, reason)

        async def work() -> None:
            begin_or_cancel = self._test.cancel if request.cancel else self._test.begin
            response.message = await begin_or_cancel(who, reason)

        return await self._answer(response, work(), 'performance test')

    async def _look_after_test(self) -> None:
        self._by = Author()
        try:
            await self._test.look()
        except (AuditError, RefusedError) as error:
            self.warn(f'performance test: {error}')

    def _has_record(self, batch: str) -> bool:
        return self._record is not None and self._record.has(batch)

    async def _read_started(self) -> None:
        self._notice_started()
        await self._audit.read_started()

    # Diagnostics

    def diagnose(self, now: float) -> list[Finding]:
        """Return which recipe is in use, whether changes are written down, and the clock."""
        return [
            self._diagnose_recipe(), self._audit.finding(), self._diagnose_record(),
            self._test.finding(), self._host_clock.finding(now),
        ]  # fmt: skip

    def _diagnose_recipe(self) -> Finding:
        product, first = self._production.product, self.parameters.product
        values: dict[str, float | str] = {
            'product': product.name if product else 'none', 'batch': self._production.batch,
            'recipes': self.parameters.recipes, 'items': self._production.summary().items,
        }  # fmt: skip
        found = []
        if first and product is None:
            hint = 'check that denoise, identifier and reject run, and the warnings of this node'
            found.append(Concern(Level.ERROR, f'product {first!r} is not selected yet', hint))
        well = f'product {product.name!r}' if product else 'no product is selected'
        return conclude('Recipe', well, found, values)

    def _diagnose_record(self) -> Finding:
        if self._record is None:
            return conclude('Batch record', 'none: batches are not recorded', ())
        found = []
        if trouble := self._record.trouble:
            hint = 'make room, or see to the disk: verdicts wait in memory'
            found.append(Concern(Level.ERROR, trouble, hint))
        folder = self.parameters.batch_folder
        return conclude('Batch record', f'written to {folder}', found, {'folder': folder})


def _audited(product: ProductOnLine | None) -> dict[str, object] | None:
    """Return the product and its limits as the audit log keeps them."""
    if product is None:
        return None
    return {'product': product.product, 'batch': product.batch, **limits_of(product)}


main = partial(run, ProductNode)

if __name__ == '__main__':
    main()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The product node: recipes of the line, statistics of production, and the audit log."""

from collections.abc import Awaitable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
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
from checkweigher_production.nodes.batch_recorder import LineBatches
from checkweigher_production.nodes.line_audit import LineAudit
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.nodes.performance import LineTest
from checkweigher_production.recipes import NODES, Product, read_recipes

_PATIENCE = 2.0  # s, for an answer of another node
_POLL_PERIOD = 0.5  # s
# Statistics in the entries of the audit log.
_AUDITED = ('product', 'batch', 'items', 'accepted', 'under', 'over', 'faults', 'mean', 'std_dev')


@dataclass(frozen=True)
class ProductParameters(Parameters):
    """Files of the node, and the product and the batch at the start."""

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
    """Node for the recipes of the line, the counts of its batches, and its audit log."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        self._files = ExitStack()  # before the parameters, which may be refused
        super().__init__(ProductParameters, read_only=True, overrides=overrides)
        self._host_clock = HostClock()
        try:
            self._log = self._open_log()
            self._batches = self._open_batches()
        except (AuditError, SettingsError, RecordError) as error:
            self.destroy_node()
            raise ParameterError(str(error)) from None
        self._production = self._batches.production
        self._started_nodes = LineNodes(self)
        line = LineParametersClient(self, _PATIENCE)
        name, has_record = self.get_fully_qualified_name(), self._batches.has_record
        self._audit = LineAudit(self._log, name, self._time, line, has_record, self.warn)
        self._trail = self._audit.trail
        publish = self.output(ports.PRODUCT_ON_LINE).send
        self._recipe = LineRecipe(line, publish, self._stamp, self._production.tally)
        tests = self.output(ports.PERFORMANCE_TEST)
        self._test = LineTest(self._recipe, self._trail, tests.send, self._stamp)
        self._statistics = self.output(ports.STATISTICS)
        self._feedback = self.output(ports.FILLER_FEEDBACK)
        self._results = self.output(ports.BATCH_RESULT)
        # With a record, also verdicts that were published while this node was away.
        latched = ports.VERDICT.qos if self.parameters.batch_folder else None
        self.subscribe(ports.VERDICT, self._on_verdict, qos=latched)
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate)
        self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
        self._serve()
        if self.parameters.batch_folder:
            self.subscribe(ports.STOP_REQUEST, self._on_stop_request)
            self.create_timer(_POLL_PERIOD, self._publish_ended)
        if self.parameters.audit_log:
            self._audit_others()

    def _open_log(self) -> AuditLog | None:
        path = self.parameters.audit_log
        if self.parameters.product:
            self._find(self.parameters.product)
        if path:
            return self._files.enter_context(AuditLog(Path(path)))
        if self.parameters.recipes:
            self.get_logger().warning('product.audit_log is empty: no change is written down')
        return None

    def _open_batches(self) -> LineBatches:
        audit = {}
        if self._log is not None:
            audit = {'audit_log': str(self._log.path), 'audit_hash': self._log.last_hash}
        batch, folder = self.parameters.batch, self.parameters.batch_folder
        batches = LineBatches(batch, folder, self._time, audit)
        self._files.callback(batches.close)
        return batches

    def _serve(self) -> None:
        """Offer the services, and begin the periodic work for the recipes."""
        # One callback at a time, because each waits for other nodes of the line.
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
            poll(self._advance_test)

    def _audit_others(self) -> None:
        """Begin to write changes of other nodes of the line."""
        self.create_service(RecordChange, ports.RECORD_CHANGE, self._audit.on_change)
        self.subscribe(ports.ZERO_SETTING, self._audit.on_zero_setting)
        own_group = MutuallyExclusiveCallbackGroup()
        self.create_timer(_POLL_PERIOD, self._read_started, callback_group=own_group)

    def destroy_node(self) -> None:
        """Close log and record as well."""
        self._files.close()
        super().destroy_node()

    def _stamp(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _time(self) -> str:
        seconds = self._stamp() / NANOSECONDS
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec='microseconds')

    def _add_started(self) -> None:
        started = self._started_nodes.started()
        self._recipe.add_started(started)
        self._audit.add_started(started)

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
        work = self._select(request.product, self._audit.author_of(ports.SELECT_PRODUCT))
        return await self._answer(response, work, f'product {request.product!r} was not selected')

    async def _select(self, name: str, by: Author) -> None:
        products, product = self._find(name)
        self._add_started()
        self._trail.recipes(plain(products), by)
        # Written before it is made: a change that cannot be written is not made.
        before, batch = self._production.product, self._production.batch
        old, new = map(_audited, (self._recipe.in_use, product.on_line(batch)))
        self._trail.note(changes.SELECTION, 'product', old, new, by)
        # Items that are judged by the new recipe while it is being set belong to it already.
        self._batches.use(product)
        try:
            await self._recipe.set(product, batch, partial(self._audit.announce, by=by))
        except RefusedError as error:
            self._batches.use(before if self._recipe.on_line.product else None)
            self._trail.saw(changes.REFUSED, 'product', name, str(error), by)
            raise
        self._batches.control_filler(product)
        self._test.select(product, batch)
        self.count('products selected')
        self._publish()

    async def _select_at_start(self) -> None:
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
                    await self._select(name, Author())
            self._start_timer.cancel()
        except (AuditError, SettingsError, RefusedError) as error:
            self.warn(f'product {name!r} was not selected: {error}')

    async def _restore(self) -> None:
        """Set the parameters of the product in nodes of the line that were started again."""
        self._add_started()
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

    # Batches

    def _on_verdict(self, verdict: Verdict) -> None:
        if not self._batches.add(verdict):
            return
        self._recipe.update()
        self._publish()
        self._test.take(verdict)
        self._trail.verdict(verdict)
        if feedback := self._batches.feedback(verdict):
            self._feedback.send(feedback)

    def _on_stop_request(self, request: StopRequest | None) -> None:
        if request is not None:
            self._batches.write('stop', {'time': self._time(), **asdict(request)})

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        """Process the begin of a stream."""
        self._production.begin_stream()
        self._audit.on_load_cell(load_cell)

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if self._production.current.add_estimate(estimate):
            self.warn(f'item {estimate.item_id}: length or belt speed is not that of the product')

    def _publish(self) -> None:
        self._statistics.send(self._production.summary())

    async def _on_new_batch(self, request: Any, response: Any) -> Any:
        name = str(request.batch).strip()
        work = self._begin_batch(response, name, self._audit.author_of(ports.NEW_BATCH))
        return await self._answer(response, work, 'no new batch')

    async def _begin_batch(self, response: Any, name: str, by: Author) -> None:
        """Let the reject node count for another batch, then end the record of this one."""
        if not name or self._production.has_batch(name) or self._batches.has_record(name):
            raise ValueError(f'batch {name!r}: a name that was not used before is needed')
        finished = self._end_count(changes.BATCH, name, by)
        before, self._production.batch = self._production.batch, name
        try:
            await self._recipe.change(batch=name)
        except (AuditError, RefusedError) as error:
            self._production.batch = before
            self._trail.saw(changes.REFUSED, 'batch', name, str(error), by)
            raise
        self._batches.begin()
        if self._production.product is not None:
            self._test.select(self._production.product, name)
        response.finished = finished
        self._publish()

    async def _on_reset(self, request: Any, response: Any) -> Any:
        work = self._reset(response, self._audit.author_of(ports.RESET_STATISTICS))
        return await self._answer(response, work, 'statistics')

    async def _reset(self, response: Any, by: Author) -> None:
        response.finished = self._end_count(changes.RESET, None, by)
        self._batches.reset()
        self._publish()

    def _end_count(self, kind: str, batch: str | None, by: Author) -> Any:
        """Write the end of a count to the audit log, and return the message of its statistics."""
        finished = self._production.summary()
        audited = {name: getattr(finished, name) for name in _AUDITED}
        self._trail.note(kind, 'statistics', audited, batch, by)
        return to_message(ports.STATISTICS, finished)

    def _publish_ended(self) -> None:
        """Publish the records that are complete, once their hashes are in the audit log."""
        for ended in self._batches.ended():
            self._trail.saw_state(changes.RECORD, ended.batch, ended.sha256)
            self._results.send(replace(ended, stamp=self._stamp()))

    # Performance test

    async def _on_begin_test(self, request: Any, response: Any) -> Any:
        async def work() -> None:
            begin_or_cancel = self._test.cancel if request.cancel else self._test.begin
            author = Author(one_line(request.who), one_line(request.reason))
            response.message = await begin_or_cancel(author)

        return await self._answer(response, work(), 'performance test')

    async def _advance_test(self) -> None:
        try:
            await self._test.advance()
        except (AuditError, RefusedError) as error:
            self.warn(f'performance test: {error}')

    async def _read_started(self) -> None:
        self._add_started()
        await self._audit.read_started()

    # Diagnostics

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on recipe, audit log, batch record, performance test and clock."""
        return [
            self._diagnose_recipe(),
            self._audit.finding(),
            self._batches.finding(),
            self._test.finding(),
            self._host_clock.finding(now),
        ]

    def _diagnose_recipe(self) -> Finding:
        product, first = self._production.product, self.parameters.product
        values: dict[str, float | str] = {
            'product': product.name if product else 'none',
            'batch': self._production.batch,
            'recipes': self.parameters.recipes,
            'items': self._production.summary().items,
        }
        found = []
        if first and product is None:
            hint = 'check that denoise, identifier and reject run, and the warnings of this node'
            found.append(Concern(Level.ERROR, f'product {first!r} is not selected yet', hint))
        well = f'product {product.name!r}' if product else 'no product is selected'
        return conclude('Recipe', well, found, values)


def _audited(product: ProductOnLine | None) -> dict[str, object] | None:
    """Return the product and its limits as in the entries of the audit log."""
    if product is None:
        return None
    return {'product': product.product, 'batch': product.batch, **limits_of(product)}


main = partial(run, ProductNode)

if __name__ == '__main__':
    main()

"""The product node: recipes, statistics of production, and the audit log."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar

from checkweigher_msgs.msg import Statistics
from checkweigher_msgs.srv import NewBatch, ResetStatistics, SelectProduct
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from checkweigher_dsp.health.findings import Concern, Finding, Level, conclude
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.production import audit_trail
from checkweigher_dsp.production.audit_log import AuditError, AuditLog
from checkweigher_dsp.production.audit_trail import AuditTrail
from checkweigher_dsp.production.recipes import NODES, Product, RecipeError, read_recipes
from checkweigher_dsp.production.statistics import ProductionRecord
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import NANOSECONDS
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import (
    estimate_from,
    load_cell_from,
    to_message,
    verdict_from,
    zero_change_from,
)
from checkweigher_dsp.ros.line_parameters import (
    LineNodes,
    LineParametersClient,
    RefusedError,
    Values,
    python_value,
)
from checkweigher_dsp.ros.stage_node import StageNode, run

_PATIENCE = 2.0  # s, for an answer of another node
_POLL_PERIOD = 0.5  # s


@dataclass(frozen=True)
class ProductParameters(Parameters):
    """Where the recipes are, and what is on the line at the start."""

    node: ClassVar[str] = 'product'

    recipes: str = parameter('', 'recipe file; empty for none')
    product: str = parameter('', 'product that is selected at the start; empty for none')
    batch: str = parameter('', 'name of the batch at the start')
    audit_log: str = parameter('', 'file to which changes are appended; empty for none')


class ProductNode(StageNode[ProductParameters]):
    """Select the product, count what passes, note down what is changed."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(ProductParameters, read_only=True, overrides=overrides)
        self._log: AuditLog | None = None
        try:
            if self.parameters.product:
                self._find(self.parameters.product)
            if self.parameters.audit_log:
                self._log = AuditLog(Path(self.parameters.audit_log))
            elif self.parameters.recipes:
                self.get_logger().warning('product.audit_log is empty: no change is written down')
        except (AuditError, RecipeError) as error:
            self.destroy_node()
            raise ParameterError(str(error)) from None
        self._trail = AuditTrail(self._log, self.get_fully_qualified_name())
        self._record = ProductionRecord(self.parameters.batch)
        # What stood before the first recipe that set it: products that leave it out get it back.
        self._base: dict[str, Values] = {}
        # What the selected product has set, and the nodes that were started since.
        self._set: dict[str, Values] = {}
        self._lost: set[str] = set()
        self._stale = set(ports.NODES)
        self._events = 0
        self._zero_out_of_range = False
        self._advised = False
        self._line = LineParametersClient(self, _PATIENCE)
        self._nodes = LineNodes(self)
        self._statistics = self.create_publisher(
            ports.STATISTICS.type, ports.STATISTICS.name, ports.STATISTICS.qos
        )
        self.subscribe(ports.VERDICT, self._on_verdict)
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate)
        self._serve()
        if self._log is not None:
            self.subscribe(ports.PARAMETER_EVENTS, self._on_parameter_event)
            self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
            self.subscribe(ports.ZERO_SETTING, self._on_zero_setting)
            self.create_timer(
                _POLL_PERIOD, self._take_inventory, callback_group=MutuallyExclusiveCallbackGroup()
            )

    def destroy_node(self) -> None:
        """Close the log as well."""
        if self._log is not None:
            self._log.close()
            self._log = None
        super().destroy_node()

    def _serve(self) -> None:
        """Offer the services: one at a time, for each waits for the others of the line."""
        group = MutuallyExclusiveCallbackGroup()
        for kind, name, callback in (
            (SelectProduct, 'select_product', self._on_select),
            (NewBatch, 'new_batch', self._on_new_batch),
            (ResetStatistics, 'reset_statistics', self._on_reset),
        ):
            self.create_service(kind, name, callback, callback_group=group)
        if self.parameters.recipes:
            self._start_timer = self.create_timer(
                _POLL_PERIOD, self._select_at_start, callback_group=group
            )
            self.create_timer(_POLL_PERIOD, self._restore, callback_group=group)

    def _now(self) -> str:
        seconds = self.get_clock().now().nanoseconds / NANOSECONDS
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec='microseconds')

    # Recipes

    def _find(self, name: str) -> tuple[dict[str, Product], Product]:
        path = self.parameters.recipes
        if not path:
            raise RecipeError('the parameter recipes of the node product names no file')
        products = read_recipes(Path(path))
        if name not in products:
            raise RecipeError(f'{path}: has no product {name!r}; it has {", ".join(products)}')
        return products, products[name]

    async def _on_select(
        self, request: SelectProduct.Request, response: SelectProduct.Response
    ) -> SelectProduct.Response:
        try:
            await self._select(str(request.product))
            response.success = True
        except (AuditError, RecipeError, RefusedError) as error:
            response.message = str(error)
            self.warn(f'product {request.product!r} was not selected: {error}')
        return response

    async def _select_at_start(self) -> None:
        name = self.parameters.product
        if not all(self._line.ready(node) for node in NODES):
            if name:
                self.warn(f'product {name!r} waits for the nodes of the line')
            return
        if self._log is not None and self._stale.intersection(NODES):
            return  # the log has to have the values that the product changes
        try:
            if self._record.product is None:
                # If only this node was started anew, what is on the line stays there.
                name = str((await self._line.get('reject', ['product']))['product']) or name
            if self._record.product is None and name:
                await self._select(name)
            self._start_timer.cancel()
        except (AuditError, RecipeError, RefusedError) as error:
            self.warn(f'product {name!r} was not selected: {error}')

    async def _restore(self) -> None:
        """Give a node of the line that was started anew what the product has set."""
        self._notice_started()
        lost = self._lost.intersection(self._set)
        if not lost or (self._log is not None and self._stale.intersection(lost)):
            return
        product = self._set['reject']['product']
        try:
            # Until all have theirs nothing is accepted, if the line needs a product.
            await self._line.set({'reject': {'product': ''}})
            nodes = [node for node in NODES if node in lost or node == 'reject']
            await self._line.set({node: self._set[node] for node in nodes})
            self._lost -= lost
            for node in sorted(lost):
                self.warn(f'{node} was started anew: it has the parameters of {product!r} again')
                self._trail.note(self._now(), audit_trail.RESTORED, node, None, product)
        except (AuditError, RefusedError) as error:
            self.warn(f'{", ".join(sorted(lost))}: started anew, without {product!r}: {error}')

    def _notice_started(self) -> None:
        started = self._nodes.started()
        self._lost.update(started)
        self._stale.update(started.intersection(ports.NODES))

    async def _select(self, name: str) -> None:
        products, product = self._find(name)
        self._notice_started()
        started = set(self._lost)
        self._trail.recipes(self._now(), {n: p.as_mapping() for n, p in products.items()})
        # Written before it is done: what cannot be written down is not done.
        old = self._record.product.name if self._record.product else None
        self._trail.note(self._now(), audit_trail.SELECTION, 'product', old, name)
        try:
            base = await self._with_base(product.changes())
            await self._advise()
            its = product.changes()
            changes = {n: {**base[n], **its.get(n, {})} for n in NODES if n in base}
            await self._line.set(changes)
        except RefusedError as error:
            self._trail.note(self._now(), audit_trail.REFUSED, 'product', name, str(error))
            raise
        self._base, self._set = base, changes
        self._lost -= started
        self._record.product = product
        self.count('products selected')
        self._publish()

    async def _advise(self) -> None:
        """Say once that the reject node would accept anything before it has its limits."""
        if self._advised:
            return
        needed = await self._line.get('reject', ['needs_product'])
        self._advised = True
        if not needed['needs_product']:
            self.get_logger().warning(
                'reject.needs_product is false: after its start the reject node accepts by the '
                'limits of its parameter file until it has those of a product'
            )

    async def _with_base(self, changes: dict[str, Values]) -> dict[str, Values]:
        """Return the values of the line itself for all that any product has set or will set."""
        base = {node: dict(values) for node, values in self._base.items()}
        for node, values in changes.items():
            if not self._line.ready(node):
                raise RefusedError(f'{node}: is not there')
            own = base.setdefault(node, {})
            own.update(await self._line.get(node, [name for name in values if name not in own]))
        return base

    # Statistics

    def _on_verdict(self, message: Any) -> None:
        verdict = verdict_from(message)
        self._record.current.add(verdict)
        self._publish()
        out = Reason.ZERO_OUT_OF_RANGE in verdict.reasons
        # Another fault says nothing of the zero.
        if out != self._zero_out_of_range and (out or not verdict.reasons):
            self._zero_out_of_range = out
            what = Reason.ZERO_OUT_OF_RANGE.value
            self._trail.note(self._now(), audit_trail.ZERO, what, not out, out)

    def _on_estimate(self, message: Any) -> None:
        statistics = self._record.current
        before = statistics.length_faults, statistics.speed_faults
        statistics.add_estimate(estimate_from(message))
        if before != (statistics.length_faults, statistics.speed_faults):
            self.warn(f'item {message.item_id}: length or belt speed is not that of the product')

    def _publish(self) -> None:
        self._statistics.publish(self._message())

    def _message(self) -> Statistics:
        return to_message(ports.STATISTICS, self._record.current.summary(self._record.batch))

    def _on_new_batch(
        self, request: NewBatch.Request, response: NewBatch.Response
    ) -> NewBatch.Response:
        name = str(request.batch).strip()
        if not name or self._record.has_batch(name):
            response.message = f'batch {name!r}: a name that was not used before is needed'
            return response
        return self._end_count(response, audit_trail.BATCH, name)

    def _on_reset(
        self, request: ResetStatistics.Request, response: ResetStatistics.Response
    ) -> ResetStatistics.Response:
        return self._end_count(response, audit_trail.RESET, None)

    def _end_count(self, response: Any, kind: str, batch: str | None) -> Any:
        finished = self._message()
        try:
            self._trail.note(self._now(), kind, 'statistics', _summary(finished), batch)
        except AuditError as error:
            response.message = str(error)
            self.warn(str(error))
            return response
        if batch is None:
            self._record.reset()
        else:
            self._record.batch = batch
        response.success, response.finished = True, finished
        self._publish()
        return response

    # Audit

    def _on_parameter_event(self, message: Any) -> None:
        namespace, _, name = message.node.rpartition('/')
        if namespace != self.get_namespace().rstrip('/'):
            return
        self._events += 1
        if message.new_parameters and name in ports.NODES:
            self._stale.add(name)  # it has just been started
        for change in message.changed_parameters:
            value = python_value(change.value)
            self._trail.parameter(self._now(), message.node, change.name, value)

    def _on_load_cell(self, message: Any) -> None:
        cell = asdict(load_cell_from(message))
        self._trail.state(self._now(), audit_trail.CALIBRATION, ports.LOAD_CELL_INFO.name, cell)

    def _on_zero_setting(self, message: Any) -> None:
        change = asdict(zero_change_from(message))
        self._trail.state(self._now(), audit_trail.ZERO, ports.ZERO_SETTING.name, change)

    async def _take_inventory(self) -> None:
        """Compare the parameters of nodes that were started with those that they had last."""
        self._notice_started()
        namespace = self.get_namespace().rstrip('/')
        for node in ports.NODES:
            if node not in self._stale or not self._line.ready(node):
                continue
            events = self._events
            try:
                values = await self._line.get_all(node)
                if events == self._events:  # else the values may be those from before the event
                    self._trail.found(self._now(), f'{namespace}/{node}', values)
                    self._stale.discard(node)
            except (AuditError, RefusedError) as error:
                self.warn(str(error))

    # Diagnostics

    def diagnose(self, now: float) -> list[Finding]:
        """Return which recipe is in use, and whether changes are written down."""
        return [self._diagnose_recipe(), self._diagnose_log()]

    def _diagnose_recipe(self) -> Finding:
        product, first = self._record.product, self.parameters.product
        values: dict[str, float | str] = {
            'product': product.name if product else 'none',
            'batch': self._record.batch,
            'recipes': self.parameters.recipes,
            'items': self._record.current.items,
        }
        found = []
        if first and product is None:
            hint = 'check that denoise, identifier and reject run, and the warnings of this node'
            found.append(Concern(Level.ERROR, f'product {first!r} is not selected yet', hint))
        well = f'product {product.name!r}' if product else 'no product is selected'
        return conclude('Recipe', well, found, values)

    def _diagnose_log(self) -> Finding:
        if self._log is None:
            return conclude('Audit log', 'none: changes are not written down', ())
        values: dict[str, float | str] = {
            'path': str(self._log.path),
            'last_hash': self._log.last_hash,
            'nodes_to_be_read': len(self._stale),
        }
        found = []
        if not self._log.path.exists():
            hint = 'it was moved or deleted under the running node: restore it and start it again'
            found.append(Concern(Level.ERROR, f'{self._log.path} is gone', hint))
        return conclude('Audit log', f'written to {self._log.path}', found, values)


def _summary(message: Statistics) -> dict[str, object]:
    """Return what the audit log keeps of statistics that end."""
    names = ('product', 'batch', 'items', 'accepted', 'under', 'over', 'faults', 'mean', 'std_dev')
    return {name: getattr(message, name) for name in names}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the node."""
    run(ProductNode, arguments)


if __name__ == '__main__':
    main()

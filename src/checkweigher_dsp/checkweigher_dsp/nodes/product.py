# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The product node: recipes of the line, statistics of production, and the audit log."""

from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
import json
from pathlib import Path
from typing import Any, ClassVar

from checkweigher_msgs.srv import NewBatch, RecordChange, ResetStatistics, SelectProduct
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from checkweigher_dsp.health.findings import Concern, Finding, Level, conclude
from checkweigher_dsp.nodes.batch_recorder import BatchRecorder
from checkweigher_dsp.nodes.line_recipe import LineRecipe
from checkweigher_dsp.nodes.parameter_audit import ParameterAudit
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.printable import one_line
from checkweigher_dsp.production import audit_trail
from checkweigher_dsp.production.audit_log import MAX_LOG, AuditError, AuditLog
from checkweigher_dsp.production.audit_trail import AuditTrail
from checkweigher_dsp.production.batch_record import RecordError
from checkweigher_dsp.production.filler_feedback import FillerController
from checkweigher_dsp.production.recipes import NODES, Product, RecipeError, read_recipes
from checkweigher_dsp.production.statistics import ProductionRecord
from checkweigher_dsp.records import (
    NANOSECONDS,
    BatchResult,
    LoadCell,
    MassEstimate,
    StopRequest,
    Verdict,
    ZeroChange,
)
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import to_message
from checkweigher_dsp.ros.line_parameters import (
    LineNodes,
    LineParametersClient,
    RefusedError,
    Values,
)
from checkweigher_dsp.ros.running import run
from checkweigher_dsp.ros.stage_node import StageNode

_PATIENCE = 2.0  # s, for an answer of another node
_POLL_PERIOD = 0.5  # s
_LONGEST_NAME = 64  # characters, of a person
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
        self._filler: FillerController | None = None
        try:
            if self.parameters.product:
                self._find(self.parameters.product)
            if self.parameters.audit_log:
                self._log = AuditLog(Path(self.parameters.audit_log))
            elif self.parameters.recipes:
                self.get_logger().warning('product.audit_log is empty: no change is written down')
            if self.parameters.batch_folder:
                self._record = self._begin_record(Path(self.parameters.batch_folder))
        except (AuditError, RecipeError, RecordError) as error:
            self.destroy_node()
            raise ParameterError(str(error)) from None
        self._trail = AuditTrail(self._log, self.get_fully_qualified_name(), self._time)
        self._started_nodes = LineNodes(self)
        line = LineParametersClient(self, _PATIENCE)
        self._audit = ParameterAudit(self.get_namespace(), line, self._trail, self.warn)
        self._recipe = LineRecipe(line, self._announce, self.get_logger().warning)
        self._statistics = self.output(ports.STATISTICS)
        self._feedback = self.output(ports.FILLER_FEEDBACK)
        self._results = self.output(ports.BATCH_RESULT)
        self.subscribe(
            ports.VERDICT, self._on_verdict,
            # With a record also those that were missed while this node was away.
            qos=ports.VERDICT.qos if self.parameters.batch_folder else None,
        )  # fmt: skip
        self.subscribe(ports.MASS_ESTIMATE, self._on_estimate)
        # One service at a time, for each waits for other nodes of the line.
        group = MutuallyExclusiveCallbackGroup()
        for kind, name, callback in (
            (SelectProduct, 'select_product', self._on_select),
            (NewBatch, 'new_batch', self._on_new_batch),
            (ResetStatistics, 'reset_statistics', self._on_reset),
        ):
            self.create_service(kind, name, callback, callback_group=group)
        if self.parameters.recipes:
            poll = partial(self.create_timer, _POLL_PERIOD, callback_group=group)
            self._start_timer = poll(self._select_at_start)
            poll(self._restore)
        if self._record is not None:
            self.subscribe(ports.STOP_REQUEST, self._on_stop_request)
            self.create_timer(_POLL_PERIOD, self._tell_ended)
        if self._log is not None:
            self.create_service(RecordChange, ports.RECORD_CHANGE, self._on_change)
            self.subscribe(ports.LOAD_CELL_INFO, self._on_load_cell)
            self.subscribe(ports.ZERO_SETTING, self._on_zero_setting)
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

    def _time(self) -> str:
        seconds = self.get_clock().now().nanoseconds / NANOSECONDS
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec='microseconds')

    def _begin_record(self, folder: Path) -> BatchRecorder:
        audit = {}
        if self._log is not None:
            audit = {'audit_log': str(self._log.path), 'audit_hash': self._log.last_hash}
        return BatchRecorder(folder, self._production, self._time(), audit)

    def _notice_started(self) -> None:
        started = self._started_nodes.started()
        self._recipe.add_started(started)
        self._audit.add_started(started)

    # Recipes

    def _find(self, name: str) -> tuple[dict[str, Product], Product]:
        path = self.parameters.recipes
        if not path:
            raise RecipeError('the parameter recipes of the node product names no file')
        products = read_recipes(Path(path))
        if name not in products:
            raise RecipeError(f'{path}: has no product {name!r}; it has {", ".join(products)}')
        return products, products[name]

    async def _on_select(self, request: Any, response: Any) -> Any:
        try:
            await self._select(str(request.product))
            response.success = True
        except (AuditError, RecipeError, RefusedError) as error:
            response.message = str(error)
            self.warn(f'product {request.product!r} was not selected: {error}')
        return response

    async def _select(self, name: str) -> None:
        products, product = self._find(name)
        self._notice_started()
        self._trail.recipes({n: p.as_mapping() for n, p in products.items()})
        # Written before it is done: a change that cannot be written down is not made.
        before = self._production.product
        self._trail.note(audit_trail.SELECTION, 'product', before.name if before else None, name)
        # Items that are judged by the new recipe while it is set belong to it already.
        self._use(product)
        try:
            await self._recipe.set(product, self._of_batch())
        except RefusedError as error:
            self._use(before)
            self._trail.saw(audit_trail.REFUSED, 'product', name, str(error))
            raise
        self._control_filler(product)
        self.count('products selected')
        self._publish()

    def _use(self, product: Product | None) -> None:
        """Count for a product from now on."""
        self._production.product = product
        if self._record is not None and product is not None:
            self._record.write('product', asdict(product))

    def _of_batch(self) -> Values:
        """Return the parameters of the reject node that are of the batch."""
        counts = self._production.tally.counts
        return {'batch': self._production.batch, 'batch_counts': counts}

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
        name = self.parameters.product
        if not self._recipe.ready:
            if name:
                self.warn(f'product {name!r} waits for the nodes of the line')
            return
        if self._awaits_audit(set(NODES)):
            return
        try:
            if self._production.product is None:
                # If only this node was started again, the product on the line stays.
                name = await self._recipe.product_on_line() or name
            if self._production.product is None and name:
                await self._select(name)
            self._start_timer.cancel()
        except (AuditError, RecipeError, RefusedError) as error:
            self.warn(f'product {name!r} was not selected: {error}')

    async def _restore(self) -> None:
        """Give nodes of the line that were started again the parameters of the product."""
        self._notice_started()
        lost = self._recipe.lost
        if not lost or self._awaits_audit(lost):
            return
        try:
            product = await self._recipe.restore(self._of_batch)
            for node in sorted(lost):
                self.warn(f'{node} was started again: it has the parameters of {product!r} again')
                self._trail.saw(audit_trail.RESTORED, node, None, product)
        except RefusedError as error:
            self.warn(f'{", ".join(sorted(lost))}: started again, without the product: {error}')

    # Statistics

    def _on_verdict(self, verdict: Verdict) -> None:
        if not self._production.add(verdict):
            return  # it came before this node was started again
        if self._record is not None:
            self._record.write('verdict', verdict)
        self._publish()
        self._trail.verdict(verdict)
        if self._filler and (feedback := self._filler.add(verdict)):
            self._feedback.send(feedback)
            if self._record is not None:
                self._record.write('filler', feedback)

    def _on_stop_request(self, request: StopRequest | None) -> None:
        if self._record is not None and request is not None:
            self._record.write('stop', {'time': self._time(), **asdict(request)})

    def _on_estimate(self, estimate: MassEstimate) -> None:
        if self._production.current.add_estimate(estimate):
            self.warn(f'item {estimate.item_id}: length or belt speed is not that of the product')

    def _publish(self) -> None:
        self._statistics.send(self._production.summary())

    async def _on_new_batch(self, request: Any, response: Any) -> Any:
        name = str(request.batch).strip()
        if not name or self._production.has_batch(name) or self._has_record(name):
            response.message = f'batch {name!r}: a name that was not used before is needed'
            return response
        try:
            await self._end_count(response, audit_trail.BATCH, name)
        except (AuditError, RefusedError) as error:
            response.message = str(error)
            self.warn(f'batch {name!r}: {error}')
        return response

    async def _on_reset(self, request: Any, response: Any) -> Any:
        try:
            await self._end_count(response, audit_trail.RESET, None)
        except AuditError as error:
            response.message = str(error)
            self.warn(str(error))
        return response

    async def _end_count(self, response: Any, kind: str, batch: str | None) -> None:
        finished = self._production.summary()
        audited = {name: getattr(finished, name) for name in _AUDITED}
        self._trail.note(kind, 'statistics', audited, batch)
        if batch is None:
            self._production.reset()
            if self._record is not None:
                self._record.write('reset', {'time': self._time()})
        else:
            await self._change_batch(batch)
        response.success, response.finished = True, to_message(ports.STATISTICS, finished)
        self._publish()

    async def _change_batch(self, batch: str) -> None:
        """Have the reject node count for another batch, then end the record of this one."""
        before, self._production.batch = self._production.batch, batch
        try:
            await self._recipe.set_batch(self._of_batch())
        except (AuditError, RefusedError) as error:
            self._production.batch = before
            self._trail.saw(audit_trail.REFUSED, 'batch', batch, str(error))
            raise
        if self._record is not None:
            self._record.change(batch, self._time())
            if self._production.product is not None:
                self._use(self._production.product)

    def _tell_ended(self) -> None:
        """Tell of records that are complete, once the audit log has their hashes."""
        for ended in self._record.ended() if self._record else ():
            self._trail.saw_state(audit_trail.RECORD, ended.batch, ended.sha256)
            stamp = self.get_clock().now().nanoseconds
            path = str(ended.path.resolve())
            self._results.send(BatchResult(stamp, ended.batch, path, ended.sha256))

    # Audit

    def _awaits_audit(self, nodes: set[str]) -> bool:
        """Tell whether the log has to have parameters of some nodes before they are changed."""
        return self._log is not None and not self._audit.unread.isdisjoint(nodes)

    def _announce(self, changes: dict[str, Values]) -> None:
        if self._log is not None:
            self._audit.announce(changes)

    def _on_change(self, request: Any, response: Any) -> Any:
        """Write down what a node of the line is about to change."""
        try:
            self._write_change(request.kind, request.subject, json.loads(request.new_value))
            response.success = True
        except (AuditError, ValueError, RecursionError) as error:
            response.message = str(error)
            self.warn(f'{request.subject}: {request.kind}: not written down, so refused: {error}')
        return response

    def _write_change(self, kind: str, subject: str, value: Any) -> None:
        namespace, _, node = subject.rpartition('/')
        here = namespace == self.get_namespace().rstrip('/')
        learner = self.resolve_service_name('identifier')
        tuner = self.resolve_service_name(ports.DYNAMIC_SETTING.name)
        if kind == audit_trail.PARAMETER and here and isinstance(value, dict):
            self._audit.announce({node: value})
        elif (kind, subject) == (audit_trail.CALIBRATION, ports.LOAD_CELL_INFO.name):
            self._trail.state(kind, subject, value)
        elif (kind, subject) in (
            (audit_trail.ZERO, ports.ZERO), (audit_trail.LEARNED, learner),
            (audit_trail.TUNED, tuner),
        ):  # fmt: skip
            self._trail.note(kind, subject, None, value)
        elif kind == audit_trail.REPORT and self._has_record(subject):
            self._trail.state(kind, subject, value)
        elif (
            kind == audit_trail.PERSON and len(subject) <= _LONGEST_NAME and isinstance(value, str)
        ):
            self._trail.note(kind, one_line(subject), None, one_line(value))
        else:
            raise AuditError(f'{kind} of {subject}: is nothing that is changed on this lane')

    def _has_record(self, batch: str) -> bool:
        return self._record is not None and self._record.has(batch)

    async def _read_started(self) -> None:
        self._notice_started()
        with suppress(AuditError):  # the diagnostics tell
            self._trail.catch_up()
        await self._audit.read_started()

    def _on_load_cell(self, load_cell: LoadCell) -> None:
        name = ports.LOAD_CELL_INFO.name
        self._trail.saw_state(audit_trail.CALIBRATION, name, asdict(load_cell))

    def _on_zero_setting(self, change: ZeroChange) -> None:
        self._trail.saw_state(audit_trail.ZERO, ports.ZERO_SETTING.name, asdict(change))

    # Diagnostics

    def diagnose(self, now: float) -> list[Finding]:
        """Return which recipe is in use, and whether changes are written down."""
        return [self._diagnose_recipe(), self._diagnose_log(), self._diagnose_record()]

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

    def _diagnose_log(self) -> Finding:
        if self._log is None:
            return conclude('Audit log', 'none: changes are not written down', ())
        values: dict[str, float | str] = {
            'path': str(self._log.path), 'last_hash': self._log.last_hash,
            'nodes_to_be_read': len(self._audit.unread),
        }  # fmt: skip
        found = []
        if trouble := self._log.trouble():
            hint = 'changes are refused: restore log and LOG.head, and start product again'
            found.append(Concern(Level.ERROR, trouble, hint))
        elif self._trail.trouble:
            hint = 'changes are refused: make room, or see to the disk'
            found.append(Concern(Level.ERROR, self._trail.trouble, hint))
        if self._log.size > 0.9 * MAX_LOG:
            text = f'{self._log.path} has {self._log.size} bytes of {MAX_LOG} at most'
            found.append(Concern(Level.WARN, text, 'name another file in audit_log'))
        return conclude('Audit log', f'written to {self._log.path}', found, values)

    def _diagnose_record(self) -> Finding:
        if self._record is None:
            return conclude('Batch record', 'none: batches are not recorded', ())
        found = []
        if trouble := self._record.trouble:
            hint = 'make room, or see to the disk: verdicts wait in memory'
            found.append(Concern(Level.ERROR, trouble, hint))
        folder = self.parameters.batch_folder
        return conclude('Batch record', f'written to {folder}', found, {'folder': folder})


main = partial(run, ProductNode)

if __name__ == '__main__':
    main()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selection of product and batch by an operator, at the first start and after a restart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path

from checkweigher_core import changes
from checkweigher_core.health.findings import Concern, Finding, conclude, error_if, warn_if
from checkweigher_core.parameters import SettingsError
from checkweigher_core.records import BatchResult, ProductOnLine, Statistics
from checkweigher_core.ros.line_parameters import RefusedError
from checkweigher_core.settings_files import plain
from checkweigher_dsp.rejection.parameters import limit_text, limits_of
from checkweigher_production.audit_log import AuditError
from checkweigher_production.audit_trail import Author
from checkweigher_production.batch_record import ENDED, RecordError
from checkweigher_production.nodes.batch_recorder import LineBatches
from checkweigher_production.nodes.line_audit import LineAudit
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.nodes.performance import LineTest
from checkweigher_production.recipes import NODES, Product, read_recipes

# Fields of `Statistics` that are written to the audit log.
_COUNTED = ('product', 'batch', 'items', 'accepted', 'under', 'over', 'faults', 'mean', 'std_dev')


def find(file: str, name: str) -> tuple[dict[str, Product], Product]:
    """Return all products of a recipe file, and the product `name`.

    Raises `SettingsError` if `file` is empty, or if the file is not valid or has no such product.
    """
    if not file:
        raise SettingsError('product.recipes: empty, must name a recipe file')
    products = read_recipes(Path(file))
    if name not in products:
        raise SettingsError(f'{file}: has no product {name!r}; it has {", ".join(products)}')
    return products, products[name]


@dataclass(eq=False)
class LineSelection:
    """Selection of product and batch.

    Each change of the selection is written to the audit log before it is made. The restoration of
    the parameters in a restarted node is written afterwards. `file` is the path of the recipe file,
    or empty if the line has no recipes. `first` is the name of the product that is selected at a
    start without a stored selection, or empty if none is selected then. `warn` logs a warning.
    """

    file: str
    first: str
    recipe: LineRecipe
    batches: LineBatches
    audit: LineAudit
    test: LineTest
    warn: Callable[[str], object]

    def __post_init__(self) -> None:
        # Product and limits of the last run that are not restored yet.
        selected = self.batches.selected
        self._resumed = (selected.product, selected.on_line) if selected else (None, None)
        self._begun = not self.file  # whether the selection at the start is completed

    async def select(self, name: str, by: Author) -> None:
        """Select a product.

        If a node refuses a parameter, the previous product remains selected. No product is selected
        if changed parameters cannot be restored, or if the reject node does not confirm the product
        after parameters were changed.

        Raises `SettingsError` if the recipe file is not valid or has no such product, or if no
        batch is in progress. Raises `AuditError` if the audit log cannot be written. Raises
        `RefusedError` if a node refuses a parameter or does not answer.
        """
        products, product = find(self.file, name)
        if self.batches.doubt:
            raise SettingsError(self.batches.doubt)
        trail, production = self.audit.trail, self.batches.production
        trail.recipes(plain(products), by)
        # The entry is written first, because a change without an entry must not be made.
        before, wanted = production.product, product.on_line(production.batch)
        trail.note(changes.SELECTION, 'product', _audited(self.recipe.in_use), _audited(wanted), by)
        # Items are counted for the new product from now on, because its limits may apply before the
        # call of `set` returns.
        self.batches.use(product)
        try:
            await self.recipe.set(product, wanted, partial(self.audit.announce, by=by))
        except (AuditError, RefusedError) as error:
            self.batches.use(before if self.recipe.on_line.product else None)
            trail.saw(changes.REFUSED, 'product', name, str(error), by)
            raise
        finally:
            self.batches.keep(self.recipe.selected, always=True)
        self._resumed = None, None
        if why := product.unresolved(production.std_dev):
            self.warn(f'product {name!r}: {why}')
        self._select_in_counts(product)

    def _select_in_counts(self, product: Product) -> None:
        self.batches.control_filler(product)
        self.test.select(product, self.batches.production.batch)

    def taken(self, product: ProductOnLine) -> None:
        """Update the selection after the reject node has confirmed that it uses a product."""
        if self.batches.doubt:
            # Use no product, because no item may be accepted while no batch is in progress.
            product = replace(product, product='')
        recipe, limits = self._resumed
        if recipe is not None and self.recipe.in_use is None:
            self._select_in_counts(recipe)
        # A product with parameters is not put on the line until the nodes have these parameters.
        self.recipe.taken(product, limits, waits=recipe is not None and bool(recipe.parameters))
        if product.product:
            self.batches.keep(self.recipe.selected)

    async def select_at_start(self) -> bool:
        """Select the product of the stored selection, or `first` without a stored selection.

        If only this node was restarted, the product on the line remains selected. Returns True if
        this call has completed the selection at the start with a product, and otherwise False.

        The method must be called repeatedly, because it has no effect while nodes are missing or
        their parameters have not been read.
        """
        if self._begun or self.batches.doubt:
            return False
        resumed, _ = self._resumed
        first = '' if self.batches.in_doubt else self.first
        name = first if resumed is None else resumed.name
        if not self.recipe.ready:
            if name:
                self.warn(f'product {name!r} waits for the nodes of the line')
            return False
        if self.audit.awaits(set(NODES)):
            return False
        # If only this node was restarted, the product on the line is still in use.
        name = self.recipe.on_line.product or name
        try:
            await self._begin(name)
        except (AuditError, SettingsError, RefusedError) as error:
            self.warn(f'product {name!r} was not selected: {error}')
            return False
        self._begun, self._resumed = True, (None, None)
        return bool(name)

    async def _begin(self, name: str) -> None:
        """Restore the product of the last run with its limits, or select the product `name`.

        Nothing is selected if `name` is empty, or if a person has already selected a product.
        """
        resumed, limits = self._resumed
        if resumed is not None and limits is not None and resumed.name == name:
            known = self.recipe.on_line if self.recipe.on_line.product else limits
            # An operator may have begun a batch since the restart.
            wanted = replace(known, batch=self.batches.production.batch)
            await self.recipe.set(resumed, wanted, partial(self.audit.announce, by=Author()))
        elif name and self.batches.production.product is None:
            await self.select(name, Author())

    async def restore(self) -> None:
        """Set the parameters of the product in the nodes that have been restarted.

        If a node refuses a parameter, a warning is logged, and the next call tries again.
        """
        lost = self.recipe.lost
        if not lost or self.audit.awaits(lost):
            return
        try:
            product = await self.recipe.restore()
            for node in sorted(lost):
                self.warn(f'{node} was started again: it has the parameters of {product!r} again')
                self.audit.trail.saw(changes.RESTORED, node, None, product)
        except RefusedError as error:
            self.warn(f'{", ".join(sorted(lost))}: started again, without the product: {error}')

    async def begin_batch(self, name: str, by: Author) -> Statistics:
        """Begin a batch, end the previous batch, and return the statistics of the previous batch.

        Raises `RecordError` if the name is empty or was used before, or if a record to be continued
        is not valid. Raises `AuditError` if the audit log cannot be written, and `RefusedError` if
        the reject node does not confirm the batch. If an exception is raised, the previous batch
        continues.
        """
        continues = bool(self.batches.doubt) and self.batches.has_record(name)
        is_known = self.audit.trail.last(changes.RECORD, name) is not None and not continues
        if not name or is_known or not self.batches.may_begin(name):
            raise RecordError(f'batch {name!r}: a batch needs a name that was not used before')
        production = self.batches.production
        # Items that pass until the new batch begins are still counted in these statistics.
        ended = production.current
        self._end_count(changes.BATCH, name, by)
        before, production.batch = production.batch, name
        try:
            await self.recipe.change(batch=name)
            self.batches.begin()
        except (AuditError, RecordError, RefusedError) as error:
            production.batch = before
            self.audit.trail.saw(changes.REFUSED, 'batch', name, str(error), by)
            raise
        finally:
            self.batches.keep(self.recipe.selected, always=True)
        if production.product is not None:
            self.test.select(production.product, name)
        return ended.summary(before)

    async def reset_counts(self, by: Author) -> Statistics:
        """Reset the counts of the present product and batch, and return the statistics so far.

        If the audit log cannot be written, `AuditError` is raised, and the counts are unchanged.
        """
        finished = self._end_count(changes.RESET, None, by)
        self.batches.reset()
        return finished

    def _end_count(self, kind: str, batch: str | None, by: Author) -> Statistics:
        finished = self.batches.production.summary()
        audited = {name: getattr(finished, name) for name in _COUNTED}
        self.audit.trail.note(kind, 'statistics', audited, batch, by)
        return finished

    def ended_batches(self) -> Iterator[BatchResult]:
        """Write the states of records to the audit log, and yield the results of ended batches.

        A batch whose report is in the audit log is left out. The stamp of a result is 0.
        """
        for state in self.batches.states():
            self.audit.write_state(state)
            if state.event == ENDED and self.audit.trail.last(changes.REPORT, state.batch) is None:
                record = str(self.batches.record_of(state.batch))
                yield BatchResult(0, state.batch, record, state.sha256)

    def _other_limits(self) -> Concern | None:
        """Return a concern if the limits in use differ from those of the recipe, otherwise None.

        The concern is an error if the line lacks a limit of the recipe, because the line then
        accepts items that the recipe rejects, however far they are beyond the limit.
        """
        product, in_use = self.batches.production.product, self.recipe.in_use
        if product is None or in_use is None or in_use.product != product.name:
            return None
        recipe = product.on_line(in_use.batch)
        own, used = limits_of(recipe), limits_of(in_use)
        is_lost = any(math.isfinite(own[name]) and math.isinf(used[name]) for name in own)
        text = (
            f'the limits on the line, {_grams(in_use)}, are not those of the recipe, '
            f'{_grams(recipe)}'
        )
        hint = 'select the product again, or change its recipe'
        if is_lost:
            return error_if(True, text, hint)
        return warn_if(own != used, text, hint)

    def finding(self) -> Finding:
        """Return the diagnostics finding "Recipe", with the product, the batch and the file."""
        production = self.batches.production
        product = production.product
        unresolved = product.unresolved(production.std_dev) if product else ''
        values: dict[str, float | str] = {
            'product': product.name if product else 'none',
            'batch': production.batch,
            'recipes': self.file,
            'items': production.summary().items,
        }
        concerns = (
            error_if(
                bool(self.first) and product is None,
                f'product {self.first!r} is not selected yet',
                'check that denoise, identifier and reject run, and the warnings of this node',
            ),
            error_if(
                bool(self.file) and product is None,
                'no product is selected, so nothing is accepted',
                'select one on the page, or by the service select_product',
            ),
            self._other_limits(),
            warn_if(
                bool(unresolved), unresolved, 'train this product, or run the belt at a lower speed'
            ),
        )
        well = f'product {product.name!r}' if product else 'no product is selected'
        return conclude('Recipe', well, concerns, values)


def _grams(product: ProductOnLine) -> str:
    return f'{limit_text(product.lower_limit)} and {limit_text(product.upper_limit)}'


def _audited(product: ProductOnLine | None) -> dict[str, object] | None:
    """Return a product and its limits as the value of an audit log entry (None for None)."""
    if product is None:
        return None
    return {'product': product.product, 'batch': product.batch, **limits_of(product)}

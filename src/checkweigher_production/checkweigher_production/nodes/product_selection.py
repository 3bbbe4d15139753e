# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selection of a product: by an operator, at the start of the line, and after a restart."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from checkweigher_core import changes
from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.parameters import SettingsError
from checkweigher_core.records import ProductOnLine
from checkweigher_core.ros.line_parameters import RefusedError
from checkweigher_core.settings_files import plain
from checkweigher_dsp.rejection.parameters import limits_of
from checkweigher_production.audit_log import AuditError
from checkweigher_production.authors import Author
from checkweigher_production.nodes.batch_recorder import LineBatches
from checkweigher_production.nodes.line_audit import LineAudit
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.nodes.performance import LineTest
from checkweigher_production.recipes import NODES, Product, read_recipes


def find(file: str, name: str) -> tuple[dict[str, Product], Product]:
    """Return all products of a recipe file, and one of them; `SettingsError` if it is not there."""
    if not file:
        raise SettingsError('the parameter recipes of the node product names no file')
    products = read_recipes(Path(file))
    if name not in products:
        raise SettingsError(f'{file}: has no product {name!r}; it has {", ".join(products)}')
    return products, products[name]


class ProductSelection:
    """Selection of a product of a recipe file for the nodes of the line, counts and records.

    `file` is the recipe file, empty for none, and `first` the product at the first start, empty for
    none. `warn` logs a warning.
    """

    def __init__(
        self,
        file: str,
        first: str,
        recipe: LineRecipe,
        batches: LineBatches,
        audit: LineAudit,
        test: LineTest,
        warn: Callable[[str], object],
    ) -> None:
        self._file = file
        self._first = first
        self._recipe = recipe
        self._batches = batches
        self._audit = audit
        self._test = test
        self._warn = warn
        # Product and limits that go on after a restart of the line, until all nodes have them.
        selected = batches.selected
        self._resumed = (selected.product, selected.on_line) if selected else (None, None)
        self._begun = not file  # whether the product at the start is on the line

    async def select(self, name: str, by: Author) -> None:
        """Select a product, or raise an error and leave all as it is."""
        products, product = find(self._file, name)
        if self._batches.doubt:
            raise SettingsError(self._batches.doubt)
        trail, production = self._audit.trail, self._batches.production
        trail.recipes(plain(products), by)
        # Written before it is made: a change that cannot be written is not made.
        before, wanted = production.product, product.on_line(production.batch)
        trail.note(
            changes.SELECTION, 'product', _audited(self._recipe.in_use), _audited(wanted), by
        )
        # Items that are judged by the new recipe while it is being set belong to it already.
        self._batches.use(product)
        try:
            await self._recipe.set(product, wanted, partial(self._audit.announce, by=by))
        except RefusedError as error:
            self._batches.use(before if self._recipe.on_line.product else None)
            trail.saw(changes.REFUSED, 'product', name, str(error), by)
            raise
        finally:
            self._batches.keep(self._recipe.selected, anew=True)
        self._resumed = None, None
        self._select_in_counts(product)

    def _select_in_counts(self, product: Product) -> None:
        self._batches.control_filler(product)
        self._test.select(product, self._batches.production.batch)

    def taken(self, product: ProductOnLine) -> None:
        """Process the product by which the reject node judges from now on."""
        if self._batches.doubt:  # nothing is accepted that no batch counts
            product = replace(product, product='')
        recipe, limits = self._resumed
        if recipe is not None and self._recipe.in_use is None:
            self._select_in_counts(recipe)
        # With parameters of its own a product waits until the nodes have them.
        self._recipe.taken(product, limits, waits=recipe is not None and bool(recipe.parameters))
        if product.product:
            self._batches.keep(self._recipe.selected)

    async def select_at_start(self) -> bool:
        """Select the product of before or the first one; return whether that was done just now."""
        if self._begun or self._batches.doubt:
            return False
        resumed, _ = self._resumed
        first = '' if self._batches.in_doubt else self._first
        name = first if resumed is None else resumed.name
        if not self._recipe.ready:
            if name:
                self._warn(f'product {name!r} waits for the nodes of the line')
            return False
        if self._audit.awaits(set(NODES)):
            return False
        # If only this node was started again, the product on the line stays.
        name = self._recipe.on_line.product or name
        try:
            await self._begin(name)
        except (AuditError, SettingsError, RefusedError) as error:
            self._warn(f'product {name!r} was not selected: {error}')
            return False
        self._begun, self._resumed = True, (None, None)
        return bool(name)

    async def _begin(self, name: str) -> None:
        """Set the product of before with its limits, or select another one; '' for none."""
        resumed, limits = self._resumed
        if resumed is not None and limits is not None and resumed.name == name:
            on_line = self._recipe.on_line
            # A batch may have begun meanwhile.
            batch = self._batches.production.batch
            limits = replace(on_line if on_line.product else limits, batch=batch)
            await self._recipe.set(resumed, limits, partial(self._audit.announce, by=Author()))
        elif name and self._batches.production.product is None:
            await self.select(name, Author())  # otherwise the limits of the line hold

    async def restore(self) -> None:
        """Set the parameters of the product in nodes of the line that were started again."""
        lost = self._recipe.lost
        if not lost or self._audit.awaits(lost):
            return
        try:
            product = await self._recipe.restore()
            for node in sorted(lost):
                self._warn(f'{node} was started again: it has the parameters of {product!r} again')
                self._audit.trail.saw(changes.RESTORED, node, None, product)
        except RefusedError as error:
            self._warn(f'{", ".join(sorted(lost))}: started again, without the product: {error}')

    def finding(self) -> Finding:
        """Return the aspect Recipe of the diagnostics."""
        production = self._batches.production
        product = production.product
        values: dict[str, float | str] = {
            'product': product.name if product else 'none',
            'batch': production.batch,
            'recipes': self._file,
            'items': production.summary().items,
        }
        found = []
        if self._first and product is None:
            hint = 'check that denoise, identifier and reject run, and the warnings of this node'
            found.append(Concern(Level.ERROR, f'product {self._first!r} is not selected yet', hint))
        elif self._file and product is None:
            hint = 'select one on the page, or by the service select_product'
            text = 'no product is selected, so nothing is accepted'
            found.append(Concern(Level.ERROR, text, hint))
        well = f'product {product.name!r}' if product else 'no product is selected'
        return conclude('Recipe', well, found, values)


def _audited(product: ProductOnLine | None) -> dict[str, object] | None:
    """Return the product and its limits as in the entries of the audit log."""
    if product is None:
        return None
    return {'product': product.product, 'batch': product.batch, **limits_of(product)}

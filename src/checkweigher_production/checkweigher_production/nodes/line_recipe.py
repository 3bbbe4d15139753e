# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of the selected product in the reject node, and its parameters in all nodes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from rclpy.task import Future

from checkweigher_core.changes import plain
from checkweigher_core.records import ProductOnLine
from checkweigher_core.ros.line_parameters import (
    HalfSetError,
    LineParametersClient,
    RefusedError,
    Values,
)
from checkweigher_dsp.rejection.batch_rules import BatchTally
from checkweigher_production.recipes import NODES, Product


@dataclass(eq=False)
class LineRecipe:
    """Setter of the limits of the selected product, and of its parameters in all nodes.

    A product is "on the line" when it is published to the reject node. While the parameters of the
    nodes are set, no product is on the line, and the reject node accepts no item. The methods
    `set`, `change` and `restore` publish a product and await the confirmation of the reject node.
    No confirmation is awaited for a publication after a failure. If a node refuses a parameter or
    does not answer, `set`, `change` and `restore` raise `RefusedError`.

    `line` is the client for the parameters of all nodes, `publish` publishes the product on the
    line, `clock` returns the time in ns, and `tally` returns the counts of a product in a batch.

    Attributes
    ----------
    selected : ProductOnLine or None
        Selected product with its limits, which may not be on the line yet, or None if no product is
        selected.
    on_line : ProductOnLine
        Last published product. Its name is empty if no product is on the line.
    in_use : ProductOnLine or None
        Product that the reject node has confirmed, or None before the first confirmation.
    """

    line: LineParametersClient
    publish: Callable[[ProductOnLine], object]
    clock: Callable[[], int]
    tally: Callable[[str, str], BatchTally]

    def __post_init__(self) -> None:
        self.selected: ProductOnLine | None = None
        self.on_line = ProductOnLine(0)
        self.in_use: ProductOnLine | None = None
        # Future that is done when the reject node confirms the last published product.
        self._taken = Future()
        # Original values of the parameters, from before any recipe, by node. A parameter gets its
        # original value again when a product is selected whose recipe does not set the parameter.
        self._base: dict[str, Values] = {}
        # Parameter values for the selected product, by node.
        self._set: dict[str, Values] = {}
        # Nodes that were started after the parameters of the product were last set in them.
        self._restarted: set[str] = set()

    @property
    def ready(self) -> bool:
        """Whether `in_use` is known, and the parameter services of all nodes in `NODES` exist."""
        return self.in_use is not None and all(self.line.ready(node) for node in NODES)

    @property
    def lost(self) -> set[str]:
        """Restarted nodes that do not have the parameters of the product."""
        return self._restarted & self._set.keys()

    def add_started(self, nodes: set[str]) -> None:
        """Register nodes that have started."""
        self._restarted |= nodes

    def taken(
        self, product: ProductOnLine, resumed: ProductOnLine | None = None, *, waits: bool = False
    ) -> None:
        """Update the product in use after the reject node has confirmed a product.

        If the reject node has no product when this node starts, `resumed` is selected. Unless
        `waits` is True, `resumed` is also put on the line.
        """
        first, self.in_use = self.in_use is None, product
        # When this node starts, it adopts the product of the reject node with its limits.
        if product.product and (first or product.stamp == self.on_line.stamp):
            self.on_line = self.selected = product
        elif first and not self.on_line.stamp:  # this node has not published a product yet
            self.selected = resumed
            self.put(None if waits else resumed)
        if product.stamp == self.on_line.stamp and not self._taken.done():
            self._taken.set_result(product)

    def update(self) -> None:
        """Publish the product on the line again, with the present counts of its batch.

        A restarted reject node continues from the published counts. Without a product on the line,
        nothing is published.
        """
        if self.on_line.product:
            self.publish(self._counted(self.on_line))

    async def set(
        self,
        product: Product,
        selected: ProductOnLine,
        announce: Callable[[dict[str, Values]], object],
    ) -> None:
        """Set the parameters of a product, and put the product on the line.

        `selected` contains the limits of the product. Before any parameter is set, `announce` is
        called with the new parameters by node. If `announce` raises an exception, no parameter is
        set.

        Raises `RefusedError` if the product is too slow for the segmenter, or if a node is missing,
        does not answer or refuses a parameter. The previous parameters of all nodes are then
        restored. Raises `HalfSetError`, a kind of `RefusedError`, if the previous parameters cannot
        be restored.

        Raises `RefusedError` as well if the nodes have the new parameters, but the reject node does
        not confirm the product. The new parameters are then kept. No product is then on the line if
        parameters were changed; otherwise, the previous product is put on the line again.
        """
        restarted = set(self._restarted)
        await self._check_speed(product)
        self._base = await self._base_of(product.parameters)
        own = product.parameters
        whole = {node: {**base, **own.get(node, {})} for node, base in self._base.items()}
        changes = {
            node: new
            for node, new in whole.items()
            if plain(new) != plain(await self.line.get(node, list(new)))
        }
        announce(changes)
        before = self.selected if self.on_line.product else None
        try:
            await self._change(changes, selected, before)
        except RefusedError:
            if not self.on_line.product:
                self.selected, self._set = None, {}
            raise
        self._set = whole
        self._restarted -= restarted

    async def _check_speed(self, product: Product) -> None:
        """Check that the segmenter weighs items at the largest belt speed of a product.

        Raises `RefusedError` if this speed is below the parameter `min_belt_speed` of the
        segmenter, or if the segmenter does not answer.
        """
        slowest: Any = await self.line.get('segmenter', ['min_belt_speed'])
        if product.speed[1] < slowest['min_belt_speed']:
            raise RefusedError(
                f'{product.name}.speed: {product.speed[1]:g} m/s is below min_belt_speed of '
                f'segmenter, {slowest["min_belt_speed"]:g} m/s, so no item would be weighed'
            )

    async def _base_of(self, changes: Mapping[str, Values]) -> dict[str, Values]:
        """Return the original value of each parameter that a recipe has changed or is to change.

        Raises `RefusedError` if a node is missing, does not answer or has no such parameter.
        """
        base = {node: dict(values) for node, values in self._base.items()}
        for node, values in changes.items():
            if not self.line.ready(node):
                raise RefusedError(f'{node}: is not there')
            own = base.setdefault(node, {})
            own.update(await self.line.get(node, [name for name in values if name not in own]))
        return {node: base[node] for node in NODES if node in base}

    async def change(self, **values: Any) -> None:
        """Change fields of the selected product, such as its batch, if there is a product."""
        if self.selected is None:
            return
        changed = replace(self.selected, **values)
        if self.on_line.product:
            await self._change({}, changed, self.selected)
        else:  # the product will be put on the line when all nodes have their parameters
            self.selected = changed

    async def restore(self) -> str:
        """Set the parameters of the product in all nodes in `lost`, and return the product name."""
        lost = self.lost
        assert self.selected is not None
        await self._change({n: self._set[n] for n in NODES if n in lost}, self.selected, None)
        self._restarted -= lost
        return self.selected.product

    async def _change(
        self, values: dict[str, Values], product: ProductOnLine, otherwise: ProductOnLine | None
    ) -> None:
        """Set parameters while no product is on the line, and then put `product` on the line.

        If `values` is empty, the previous product stays on the line until `product` replaces it.
        Raises `RefusedError` if a node refuses a parameter or does not answer. After a failure,
        `otherwise` is put on the line if all nodes have their previous parameters. If changed
        parameters remain, no product is put on the line.
        """
        try:
            if values:
                await self._put_and_wait(None)
                await self.line.set(values)
                otherwise = None
            await self._put_and_wait(product)
        except RefusedError as error:
            self.put(None if isinstance(error, HalfSetError) else otherwise)
            raise

    async def _put_and_wait(self, product: ProductOnLine | None) -> None:
        """Publish the product on the line, and await the confirmation of the reject node."""
        self._taken = Future()
        self.put(product)
        await self.line.answer('reject', self._taken)

    def put(self, product: ProductOnLine | None) -> None:
        """Publish the product on the line. If `product` is None, no product is on the line."""
        none = ProductOnLine(0, needed=True)
        self.on_line = self._counted(replace(product or none, stamp=self.clock()))
        self.publish(self.on_line)

    def _counted(self, product: ProductOnLine) -> ProductOnLine:
        return replace(product, **self.tally(product.product, product.batch).counts)

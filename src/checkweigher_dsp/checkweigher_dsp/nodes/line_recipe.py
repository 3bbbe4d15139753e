# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recipe of the selected product in the parameters of the nodes of the line."""

from collections.abc import Callable

from checkweigher_dsp.production.recipes import NODES, Product
from checkweigher_dsp.ros.line_parameters import LineParametersClient, RefusedError, Values


class LineRecipe:
    """Parameters that the selected product sets, in all nodes of the line or in none.

    The coroutines raise RefusedError if a node does not take a parameter or does not answer.
    `announce` takes what is about to be set, by node; it raises if it must not be. `warn` takes a
    warning for the log of the node.
    """

    def __init__(
        self, line: LineParametersClient, announce: Callable[[dict[str, Values]], object],
        warn: Callable[[str], object],
    ) -> None:  # fmt: skip
        self._line = line
        self._announce = announce
        self._warn = warn
        # Values before the first recipe that set them: products that leave them out get them back.
        self._base: dict[str, Values] = {}
        self._set: dict[str, Values] = {}  # by the selected product
        self._restarted: set[str] = set()
        self._advised = False

    @property
    def ready(self) -> bool:
        """Whether all nodes that a recipe may set are there."""
        return all(self._line.ready(node) for node in NODES)

    @property
    def lost(self) -> set[str]:
        """Nodes that were started again without the parameters of the product."""
        return self._restarted & self._set.keys()

    def add_started(self, nodes: set[str]) -> None:
        """Take which nodes have been started."""
        self._restarted |= nodes

    async def product_on_line(self) -> str:
        """Return the name of the product that the reject node has, empty for none."""
        return str((await self._line.get('reject', ['product']))['product'])

    async def set(self, product: Product, batch: Values) -> None:
        """Set the parameters of a product; if a node refuses, all keep what they had.

        `batch` has those of the reject node that are of the batch.
        """
        restarted, changes = set(self._restarted), product.changes()
        changes['reject'].update(batch)
        base = await self._base_of(changes)
        await self._advise()
        whole = {node: {**base[node], **changes.get(node, {})} for node in NODES if node in base}
        self._announce(whole)  # all at once: a log that is full in between leaves no half recipe
        await self._line.set(whole)
        self._base, self._set = base, whole
        self._restarted -= restarted

    async def _base_of(self, changes: dict[str, Values]) -> dict[str, Values]:
        """Return the line's own values of all parameters that a product has set or will set."""
        base = {node: dict(values) for node, values in self._base.items()}
        for node, values in changes.items():
            if not self._line.ready(node):
                raise RefusedError(f'{node}: is not there')
            own = base.setdefault(node, {})
            own.update(await self._line.get(node, [name for name in values if name not in own]))
        return base

    async def _advise(self) -> None:
        """Say once that the reject node would accept any item before it has its limits."""
        if self._advised:
            return
        needed = await self._line.get('reject', ['needs_product'])
        self._advised = True
        if not needed['needs_product']:
            self._warn(
                'reject.needs_product is false: after its start the reject node accepts by the '
                'limits of its parameter file until it has those of a product'
            )

    async def set_of_reject(self, values: Values) -> None:
        """Set parameters of the reject node beside those of the product, if there is one."""
        if self._set:
            self._announce({'reject': values})
            await self._line.set({'reject': values})
            self._set['reject'].update(values)

    async def restore(self, batch: Callable[[], Values]) -> str:
        """Set the parameters of the product in the nodes that lost them; return the product.

        `batch` returns those of the batch, once nothing is accepted any more.
        """
        lost, product = self.lost, str(self._set['reject']['product'])
        # Until all have theirs nothing is accepted, if the line needs a product.
        await self._line.set({'reject': {'product': ''}})
        self._set['reject'].update(batch())
        nodes = [node for node in NODES if node in lost or node == 'reject']
        await self._line.set({node: self._set[node] for node in nodes})
        self._restarted -= lost
        return product

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning step Limits: lower and upper limit of the accepted masses."""

from functools import partial
import math

from nicegui import background_tasks, ui

from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.languages.language import Text
from checkweigher_web.work import actions
from checkweigher_web.work.actions import MassLimits
from checkweigher_web.work.dialogs import field, mass_in
from checkweigher_web.work.services import ActionRefusedError, Outcome


class LimitsStep(Step):
    """Step that sets the limits of the gross mass, or selects the product if one is needed."""

    title = Text('Limits')
    to_do = Text(
        'Items below the lower or above the upper limit are rejected: gross mass, empty for no '
        'limit. A line with recipes accepts nothing until a product is selected, which sets the '
        'limits of its recipe instead.'
    )

    def _build(self) -> None:
        self._has_asked = False  # whether the products were requested from the node `product`
        self._texts = ['', '']  # texts of the limits in use that the fields last showed
        self._products = ui.select([], label=self.say('Product')).props('outlined dense')
        with ui.element('div').classes('fields') as self._fields:
            self._lower = field(self.say('Lower limit'), unit=self.say.unit)
            self._upper = field(self.say('Upper limit'), unit=self.say.unit)

    def standing(self) -> Standing:
        """Return whether a limit is set, and a text with the limits in use.

        The limits count as not set if they are not known, or if the line accepts nothing because
        no product is selected.
        """
        if self.services.product is None:
            return Standing(False, Text('the line has not said its limits yet'))
        if self._lacks_product:
            return Standing(False, Text('no product is selected, so nothing is accepted'))
        now = actions.limits(self.services)
        if not (math.isfinite(now.lower) or math.isfinite(now.upper)):
            return Standing(False, Text('no limits'))
        return Standing(True, now.text)

    @property
    def _lacks_product(self) -> bool:
        product = self.services.product
        return product is not None and product.lacks_product

    async def update(self) -> None:
        """Show the products to select from, or the limits in use.

        A field in which the user has typed is not changed.
        """
        self._products.set_visibility(self._lacks_product)
        self._fields.set_visibility(not self._lacks_product)
        if self._lacks_product and not self._has_asked:
            self._has_asked = True
            background_tasks.create(self._show_products())
        if self.services.product is None:
            return
        now = actions.limits(self.services)
        before, self._texts = self._texts, [self._entry(now.lower), self._entry(now.upper)]
        for shown, last, text in zip((self._lower, self._upper), before, self._texts, strict=True):
            if shown.value == last:
                shown.set_value(text)

    async def _show_products(self) -> None:
        try:
            known = await actions.products(self.services)
        except ActionRefusedError as error:
            self.tell(Outcome(False, error.text))
            return
        if not self._products.is_deleted:
            self._products.set_options([*known])

    def primary(self) -> Choice:
        """Return the button that sets both limits, or selects the product if one is needed.

        The limits can be set if the user has typed others than those in use.
        """
        if self._lacks_product:
            return Choice(Text('Select'), self._select, bool(self._products.value))
        is_new = [self._lower.value, self._upper.value] != self._texts
        return Choice(Text('Set the limits'), self._set, is_new)

    async def _select(self) -> None:
        name = str(self._products.value)
        select = partial(actions.select_product, self.services, name)
        await self.perform(Text('select product {name}', name=name), select)

    async def _set(self) -> None:
        wanted = MassLimits(
            mass_in(self._lower, self.say, empty=-math.inf),
            mass_in(self._upper, self.say, empty=math.inf),
        )
        set_limits = partial(actions.set_limits, self.services, wanted)
        if await self.perform(Text('set limits to {limits}', limits=wanted.text), set_limits):
            self._lower.set_value(self._entry(wanted.lower))
            self._upper.set_value(self._entry(wanted.upper))

    def _entry(self, limit: float) -> str:
        return self.say.entry(self.say.per_kg * limit) if math.isfinite(limit) else ''

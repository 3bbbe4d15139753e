# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning step Limits: lower and upper limit of the accepted masses."""

from functools import partial
import math

from nicegui import ui

from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.languages.language import Text
from checkweigher_web.work import actions
from checkweigher_web.work.actions import MassLimits
from checkweigher_web.work.dialogs import field, mass_in


class LimitsStep(Step):
    """Step that sets the limits of the gross mass."""

    title = Text('Limits')
    to_do = Text(
        'Items below the lower or above the upper limit are rejected: gross mass, empty for no '
        'limit. A line with recipes accepts nothing until a product is selected by "Product" on '
        'the page of the lane, which sets the limits of its recipe instead.'
    )

    def _build(self) -> None:
        self._texts = ['', '']  # texts of the limits in use that the fields last showed
        with ui.element('div').classes('fields'):
            self._lower = field(self.say('Lower limit'), unit=self.say.unit)
            self._upper = field(self.say('Upper limit'), unit=self.say.unit)

    def standing(self) -> Standing:
        """Return whether a limit is set, and a text with the limits in use.

        The limits count as not set if they are not known, or if the line accepts nothing because
        no product is selected.
        """
        product = self.services.product
        if product is None:
            return Standing(False, Text('the line has not said its limits yet'))
        if product.lacks_product:
            return Standing(False, Text('no product is selected, so nothing is accepted'))
        now = actions.limits(self.services)
        if not (math.isfinite(now.lower) or math.isfinite(now.upper)):
            return Standing(False, Text('no limits'))
        return Standing(True, now.text)

    def _now(self) -> MassLimits | None:
        return None if self.services.product is None else actions.limits(self.services)

    async def update(self) -> None:
        """Show the limits in use in each field in which the user has not typed."""
        now = self._now()
        if now is None:
            return
        before, self._texts = self._texts, [self._entry(now.lower), self._entry(now.upper)]
        for shown, last, text in zip((self._lower, self._upper), before, self._texts, strict=True):
            if shown.value == last:
                shown.set_value(text)

    def primary(self) -> Choice:
        """Return the button that sets both limits."""
        return Choice(Text('Set the limits'), self._set)

    async def _set(self) -> None:
        wanted = MassLimits(
            mass_in(self._lower, self.say, empty=-math.inf),
            mass_in(self._upper, self.say, empty=math.inf),
        )
        set_limits = partial(actions.set_limits, self.services, wanted)
        await self.perform(Text('set limits to {limits}', limits=wanted.text), set_limits)

    def _entry(self, limit: float) -> str:
        return self.say.entry(self.say.per_kg * limit) if math.isfinite(limit) else ''

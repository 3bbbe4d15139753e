# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning step Zero: the reading of the empty belt is set as the zero."""

from functools import partial

from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.work import actions


class ZeroStep(Step):
    """Step that sets the zero of the empty belt."""

    title = Text('Zero')
    to_do = Text(
        'Stop the feed, clear the belt, and keep away from it. Then set the zero: the line waits '
        'until the belt is empty and at rest, and reads it for some seconds. Masses are read from '
        'this zero.'
    )

    def _build(self) -> None:
        pass

    async def update(self) -> None:
        """Do nothing, because `standing` contains the time and the value of the zero."""

    def standing(self) -> Standing:
        """Return whether the zero was set, and a text with its time and its value.

        The value is the mass by which the new zero differs from the zero of calibration.
        """
        zero = self.lane.zero
        if zero is None:
            return Standing(False, Text('not set yet'))
        time, mass = self.say.clock(zero.stamp), Mass(round(zero.zero, 5))
        return Standing(True, Text('set at {time}, {mass}', time=time, mass=mass))

    def primary(self) -> Choice:
        """Return the button that sets the zero."""
        return Choice(Text('Set the zero'), self._zero)

    async def _zero(self) -> None:
        await self.perform(Text('zero'), partial(actions.zero, self.services))

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning step Static: zero and sensitivity of the load cell from known masses at rest."""

from functools import partial

from nicegui import ui

from checkweigher_core.ros import ports
from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.elements import Table
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.work.dialogs import field, mass_in
from checkweigher_web.work.services import LoadRead


class StaticStep(Step):
    """Step of the static calibration. The driver stores the readings for the calibration."""

    title = Text('Static')
    to_do = Text(
        'Stop the feed. Read the empty belt, then put known masses on it one after the other and '
        'read each, then the empty belt once more. At the end write the calibration; a product '
        'that is on the belt at that time gets no mass. The calibration before is kept. The empty '
        'belt alone sets the zero, and keeps the sensitivity.'
    )

    def _build(self) -> None:
        with ui.element('div').classes('fields'):
            say, unit = self.say, self.say.unit
            self._mass = field(say('Mass on the belt (empty: the belt is empty)'), unit=unit)
            self._uncertainty = field(say('Standard uncertainty of the mass'), '0', unit)
            self._largest = field(say('Largest deviation of a mass (empty for any)'), unit=unit)
        heads = say('mass on the belt'), say('read, as calibrated before'), say('uncertainty')
        self._table = Table(heads)

    def standing(self) -> Standing:
        """Return whether the page has written a calibration, and a text with its version.

        If there are readings that are not written yet, the step is not done, and the text contains
        the number of these readings.
        """
        readings = self.services.readings
        if readings:
            text = Text('{count} read, not written yet', count=len(readings))
            return Standing(False, text)
        done = self.services.calibrated
        return Standing(bool(done), done or Text('not done since the page was started'))

    async def update(self) -> None:
        """Show all finished readings."""
        say = self.say
        self._table.show(
            (say(each.load), say.mass(each.mass), say.mass(each.uncertainty))
            for each in self.services.readings
        )

    def request(self) -> str:
        """Return the progress of a running reading."""
        said, say = self.services.feedback.get(ports.READ_LOAD), self.say
        if said is None or not said.wanted:
            return ''
        return Text(
            'reading: {time} of {wanted}, {load}, drift {drift} of {tolerance}',
            time=say.number(said.duration, 1),
            wanted=f'{say.entry(said.wanted)} s',
            load=say.mass(said.load, 2),
            drift=say.mass(said.drift, 3, '+'),
            tolerance=say.short(said.tolerance),
        )

    def primary(self) -> Choice:
        """Return the button that reads the load on the belt."""
        return Choice(
            Text('Read the load'), self._read, ports.READ_LOAD not in self.services.feedback
        )

    def others(self) -> tuple[Choice, ...]:
        """Return the buttons that end a reading, drop all readings, and write the calibration."""
        reading, any_read = ports.READ_LOAD in self.services.feedback, bool(self.services.readings)
        return (
            Choice(Text('End reading'), self._end, reading),
            Choice(Text('Begin again'), self._forget, any_read and not reading),
            Choice(Text('Write calibration'), self._write, any_read and not reading),
        )

    async def _read(self) -> None:
        mass = mass_in(self._mass, self.say, empty=0.0)
        uncertainty = mass_in(self._uncertainty, self.say, empty=0.0) if mass else 0.0
        load = Text('{mass}', mass=Mass(mass)) if mass else Text('empty belt')

        async def read() -> str:
            answer = await self.services.do(
                ports.READ_LOAD, mass=mass, mass_uncertainty=uncertainty
            )
            cell, readings = self.lane.load_cell, self.services.readings
            if cell is None:
                return Text('read')
            scale = 1 / cell.counts_per_kg
            found = LoadRead(
                load, scale * (answer.reading - cell.zero_counts), abs(scale) * answer.std_error
            )
            # Drop the oldest readings if the driver has fewer readings than the page.
            del readings[: len(readings) + 1 - answer.points]
            readings.append(found)
            if mass and uncertainty:
                self.services.uncertainties[mass] = uncertainty
            return Text('{load}: {mass}', load=load, mass=Mass(round(found.mass, 6)))

        await self.begin(Text('read {load} for a calibration', load=load), read, ports.READ_LOAD)

    async def _end(self) -> None:
        end = partial(self.services.cancel, ports.READ_LOAD)
        await self.perform(Text('end the reading of a load'), end)

    async def _forget(self) -> None:
        forget = partial(self.services.message, ports.CANCEL_CALIBRATION)
        if await self.perform(Text('forget what was read for a calibration'), forget):
            self.services.readings.clear()

    async def _write(self) -> None:
        largest = mass_in(self._largest, self.say, empty=0.0)

        async def write() -> str:
            answer = await self.services.call(ports.FINISH_CALIBRATION, max_residual=largest)
            say = self.say
            residuals = ', '.join(
                f'{say.short(mass)} {say.mass(residual, 3, "+")}'
                for mass, residual in zip(answer.masses, answer.residuals, strict=True)
            )
            self.services.calibrated = Text('done, version {version}', version=answer.version)
            return Text(
                'calibration {version} is written and in use. Deviations: {residuals}',
                version=answer.version,
                residuals=residuals,
            )

        if await self.perform(Text('write calibration'), write):
            self.services.readings.clear()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Static: zero and sensitivity of the load cell from known masses at rest."""

from functools import partial

from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.elements import Table
from checkweigher_web.words import grams
from checkweigher_web.work.dialogs import field, number_in
from checkweigher_web.work.services import LoadRead


class StaticStep(Step):
    """Step of the static calibration. The driver stores the readings."""

    title = 'Static'
    to_do = (
        'Stop the feed. Read the empty belt, then put known masses on it one after the other and '
        'read each, then the empty belt once more. At the end write the calibration: what is on '
        'the belt is then a fault, and the calibration before is kept. The empty belt alone sets '
        'the zero, and keeps the sensitivity.'
    )

    def _build(self) -> None:
        with ui.element('div').classes('fields'):
            self._mass = field('Mass on the belt (empty: the belt is empty)', unit='g')
            self._uncertainty = field('Standard uncertainty of the mass', '0', 'g')
            self._largest = field('Largest deviation of a mass (empty for any)', unit='g')
        self._progress = ui.label('').classes('state').props('role=status')
        self._table = Table(('mass on the belt', 'read, as calibrated before', 'uncertainty'))

    def standing(self) -> Standing:
        """Return whether a calibration was written, or the number of readings."""
        readings = self.services.readings
        if readings:
            return Standing(False, f'{len(readings)} read, not written yet')
        done = self.services.calibrated
        return Standing(bool(done), done or 'not done since the page was started')

    async def update(self) -> None:
        """Show the progress of a reading, and the finished readings."""
        said = self.services.feedback.get(ports.READ_LOAD)
        self._progress.set_text(
            ''
            if said is None or not said.wanted
            else f'reading: {said.duration:.1f} of {said.wanted:g} s, {grams(said.load, " g", 2)}, '
            f'drift {GRAMS * said.drift:+.3f} g of {GRAMS * said.tolerance:g} g'
        )
        self._table.show(
            (each.load, grams(each.mass, ' g'), grams(each.uncertainty, ' g'))
            for each in self.services.readings
        )

    def primary(self) -> Choice:
        """Return the button that reads the load on the belt."""
        return Choice('Read the load', self._read, ports.READ_LOAD not in self.services.feedback)

    def others(self) -> tuple[Choice, ...]:
        """Return the buttons that end a reading, drop all readings, and write the calibration."""
        reading, any_read = ports.READ_LOAD in self.services.feedback, bool(self.services.readings)
        return (
            Choice('End reading', self._end, reading),
            Choice('Begin again', self._forget, any_read and not reading),
            Choice('Write calibration', self._write, any_read and not reading),
        )

    async def _read(self) -> None:
        mass = number_in(self._mass, empty=0.0) / GRAMS
        uncertainty = number_in(self._uncertainty, empty=0.0) / GRAMS if mass else 0.0
        load = f'{GRAMS * mass:g} g' if mass else 'empty belt'

        async def read() -> str:
            answer = await self.services.do(
                ports.READ_LOAD, mass=mass, mass_uncertainty=uncertainty
            )
            cell, readings = self.lane.load_cell, self.services.readings
            if cell is None:
                return 'read'
            scale = 1 / cell.counts_per_kg
            found = LoadRead(
                load, scale * (answer.reading - cell.zero_counts), abs(scale) * answer.std_error
            )
            # Drop the oldest readings if the driver has fewer readings than the page.
            del readings[: len(readings) + 1 - answer.points]
            readings.append(found)
            return f'{load}: {grams(found.mass, " g")}'

        await self.begin(f'read {load} for a calibration', read, ports.READ_LOAD)

    async def _end(self) -> None:
        end = partial(self.services.cancel, ports.READ_LOAD)
        await self.perform('end the reading of a load', end)

    async def _forget(self) -> None:
        forget = partial(self.services.message, ports.CANCEL_CALIBRATION)
        if await self.perform('forget what was read for a calibration', forget):
            self.services.readings.clear()

    async def _write(self) -> None:
        largest = number_in(self._largest, empty=0.0) / GRAMS

        async def write() -> str:
            answer = await self.services.call(ports.FINISH_CALIBRATION, max_residual=largest)
            residuals = ', '.join(
                f'{GRAMS * mass:g} g {GRAMS * residual:+.3f} g'
                for mass, residual in zip(answer.masses, answer.residuals, strict=True)
            )
            self.services.calibrated = f'done, version {answer.version}'
            return f'calibration {answer.version} is written and in use. Deviations: {residuals}'

        if await self.perform('write calibration', write):
            self.services.readings.clear()

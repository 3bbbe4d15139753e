# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog of the static calibration, with the empty belt and known masses."""

from functools import partial
import re
from typing import Any

from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_web.elements import Lines
from checkweigher_web.words import grams
from checkweigher_web.work.dialogs import Action, Desk, Guide, field, number_in, reason_field
from checkweigher_web.work.services import LaneServices

_PERIOD = 0.5  # s
_STEPS = (
    'Stop the feed. Read the empty belt, then put known masses on it one after the other and read '
    'each, then the empty belt once more. The empty belt alone sets the zero and keeps the '
    'sensitivity. Write the calibration at the end: the driver begins a new stream with it, what '
    'is on the belt is a fault, and the file before is kept.'
)


class CalibrationDialog(Guide):
    """Dialog of a static calibration. The driver keeps the readings."""

    title = 'Calibration'
    needs = ports.FINISH_CALIBRATION

    def __init__(self, desk: Desk, services: LaneServices) -> None:
        super().__init__(desk, services)
        with self.body:
            ui.label(_STEPS)
            self._load = ui.label('').classes('load')
            self._mass = field('Mass', unit='g')
            self._uncertainty = field('Standard uncertainty of the mass', '0', 'g')
            self._read = Lines().classes('read').props('aria-label="what was read"')
            self._largest = field('Largest residual (empty for any)', unit='g')
            self.reason = reason_field(desk)
            ui.timer(_PERIOD, self._show)
        self.button('Read empty belt', partial(self._take, 'empty belt'))
        self.button('Read mass', self._read_mass)
        cancel = partial(services.message, ports.CANCEL_CALIBRATION)
        what = 'forget what was read for a calibration'
        self.button('Begin again', partial(self._end, what, cancel))
        self.button('Write calibration', self._write)

    def _show(self) -> None:
        self._read.show(self.services.readings)
        self._load.set_text(f'On the belt now: {grams(self.desk.lane.load(), " g", 1)}')

    async def _read_mass(self) -> None:
        mass, uncertainty = number_in(self._mass), number_in(self._uncertainty, empty=0.0)
        values = {'mass': mass / GRAMS, 'mass_uncertainty': uncertainty / GRAMS}
        await self._take(f'{mass:g} g', **values)

    async def _take(self, load: str, **values: Any) -> None:
        async def read() -> str:
            text = str((await self.services.do(ports.READ_LOAD, **values)).message)
            note(self.services.readings, load, text)
            return text

        await self.perform(f'read {load} for a calibration', read)

    async def _write(self) -> None:
        largest = number_in(self._largest, empty=0.0) / GRAMS

        async def write() -> str:
            answer = await self.services.call(ports.FINISH_CALIBRATION, max_residual=largest)
            residuals = ', '.join(
                f'{GRAMS * mass:g} g {GRAMS * residual:+.4f} g'
                for mass, residual in zip(answer.masses, answer.residuals, strict=True)
            )
            return f'{answer.message}. Residuals: {residuals}'

        await self._end('write calibration', write)

    async def _end(self, what: str, end: Action) -> None:
        if await self.perform(what, end):
            self.services.readings.clear()


def note(readings: list[str], load: str, said: str) -> None:
    """Add the reading of a load, and remove readings that the driver has dropped."""
    counted = re.search(r'(\d+) read by now', said)
    if counted is not None:
        del readings[: len(readings) + 1 - int(counted[1])]
    readings.append(f'{load}: {said}')

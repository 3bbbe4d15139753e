# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The static calibration in steps: the empty belt and known masses, one after the other."""

from functools import partial
import re

from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_web.access.users import Role
from checkweigher_web.words import grams
from checkweigher_web.work.dialogs import Action, Desk, Dialog, field, number, reason_field
from checkweigher_web.work.services import LaneServices

_ROLE = Role.TECHNICIAN
_PERIOD = 0.5  # s
_STEPS = (
    'Stop the feed. Read the empty belt, then put known masses on it one after the other and read '
    'each, then the empty belt once more. The empty belt alone sets the zero and keeps the '
    'sensitivity. Write the calibration at the end: the driver begins a new stream with it, what '
    'is on the belt is a fault, and the file before is kept.'
)


async def calibrate(desk: Desk, services: LaneServices) -> None:
    """Guide through a calibration, from where it stands."""
    await services.found(ports.CALIBRATE_ZERO)
    Guide(desk, services)


class Guide:
    """The dialog of a calibration; what was read holds without it, as in the driver."""

    def __init__(self, desk: Desk, services: LaneServices) -> None:
        self._desk = desk
        self._services = services
        self._dialog = Dialog('Calibration')
        with self._dialog.body:
            ui.label(_STEPS)
            self._load = ui.label('').classes('load')
            ui.timer(_PERIOD, self._show_load)
            self._mass = field('Mass', unit='g')
            self._uncertainty = field('Standard uncertainty of the mass', '0', 'g')
            self._read = ui.element('ol').classes('read').props('aria-label="what was read"')
            self._largest = field('Largest residual (empty for any)', unit='g')
            self._reason = reason_field(desk)
        self._dialog.button('Read empty belt', self._read_empty)
        self._dialog.button('Read mass', self._read_mass)
        self._dialog.button('Begin again', self._begin_again)
        self._dialog.button('Write calibration', self._write)
        self._dialog.closing.set_text('Close')
        self._show()

    def _show_load(self) -> None:
        self._load.set_text(f'On the belt now: {grams(self._desk.lane.load(), " g", 1)}')

    def _show(self) -> None:
        self._read.clear()
        for each in self._services.readings:
            with self._read, ui.element('li'):
                ui.label(each)

    async def _begin_again(self) -> None:
        forget = partial(self._services.message, ports.CANCEL_CALIBRATION)
        await self._end('forget what was read for a calibration', forget)

    async def _read_empty(self) -> None:
        await self._take('empty belt', partial(self._services.message, ports.CALIBRATE_ZERO))

    async def _read_mass(self) -> None:
        mass, uncertainty = number(self._mass), number(self._uncertainty, empty=0.0)
        values = {'mass': mass / GRAMS, 'mass_uncertainty': uncertainty / GRAMS}
        read = partial(self._services.message, ports.CALIBRATE_SPAN, **values)
        await self._take(f'{mass:g} g', read)

    async def _take(self, load: str, read: Action) -> None:
        async def noted() -> str:
            text = await read()
            note(self._services.readings, load, text)
            return text

        await self._perform(f'read {load} for a calibration', noted)

    async def _write(self) -> None:
        largest = number(self._largest, empty=0.0)

        async def write() -> str:
            answer = await self._services.call(
                ports.FINISH_CALIBRATION, max_residual=largest / GRAMS
            )
            residuals = ', '.join(
                f'{GRAMS * mass:g} g {GRAMS * residual:+.4f} g'
                for mass, residual in zip(answer.masses, answer.residuals, strict=True)
            )
            return f'{answer.message}. Residuals: {residuals}'

        await self._end('write calibration', write)

    async def _end(self, what: str, action: Action) -> None:
        async def end() -> str:
            text = await action()
            self._services.readings.clear()
            return text

        await self._perform(what, end)

    async def _perform(self, what: str, action: Action) -> None:
        await self._dialog.perform(self._desk, _ROLE, what, self._reason, action)
        self._show()


def note(readings: list[str], load: str, said: str) -> None:
    """Add what was read of a load; what the driver has forgotten since goes."""
    counted = re.search(r'(\d+) read by now', said)
    if counted is not None:
        del readings[: len(readings) + 1 - int(counted[1])]
    readings.append(f'{load}: {said}')

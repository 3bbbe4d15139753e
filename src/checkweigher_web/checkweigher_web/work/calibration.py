# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The static calibration in steps: the empty belt and known masses, one after the other."""

import re

from nicegui import ui

from checkweigher_dsp.records import GRAMS
from checkweigher_dsp.ros import ports
from checkweigher_web.access.users import Role
from checkweigher_web.words import grams
from checkweigher_web.work.dialogs import Action, Desk, Dialog, field, number, reason_field
from checkweigher_web.work.services import LaneServices, Outcome, RefusedError

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
        async def forget() -> str:
            return str((await self._services.call(ports.CANCEL_CALIBRATION)).message)

        outcome = await self._perform('forget what was read for a calibration', forget)
        if outcome.done:
            self._services.readings.clear()
            self._show()

    async def _read_empty(self) -> None:
        async def read() -> str:
            return str((await self._services.call(ports.CALIBRATE_ZERO)).message)

        await self._take('empty belt', read)

    async def _read_mass(self) -> None:
        try:
            mass, uncertainty = number(self._mass), number(self._uncertainty, empty=0.0)
        except RefusedError as error:
            self._dialog.tell(Outcome(False, str(error)))
            return

        async def read() -> str:
            answer = await self._services.call(
                ports.CALIBRATE_SPAN, mass=mass / GRAMS, mass_uncertainty=uncertainty / GRAMS
            )
            return str(answer.message)

        await self._take(f'{mass:g} g', read)

    async def _take(self, load: str, read: Action) -> None:
        outcome = await self._perform(f'read {load} for a calibration', read)
        if outcome.done:
            note(self._services.readings, load, outcome.text)
            self._show()

    async def _write(self) -> None:
        try:
            largest = number(self._largest, empty=0.0)
        except RefusedError as error:
            self._dialog.tell(Outcome(False, str(error)))
            return

        async def write() -> str:
            answer = await self._services.call(
                ports.FINISH_CALIBRATION, max_residual=largest / GRAMS
            )
            residuals = ', '.join(
                f'{GRAMS * mass:g} g {GRAMS * residual:+.4f} g'
                for mass, residual in zip(answer.masses, answer.residuals, strict=True)
            )
            return f'{answer.message}. Residuals: {residuals}'

        outcome = await self._perform('write calibration', write)
        if outcome.done:
            self._services.readings.clear()
            self._show()

    async def _perform(self, what: str, action: Action) -> Outcome:
        reason = str(self._reason.value or '')
        outcome = await self._desk.perform(_ROLE, what, reason, action)
        self._dialog.tell(outcome)
        return outcome


def note(readings: list[str], load: str, said: str) -> None:
    """Add what was read of a load; what the driver has forgotten since goes."""
    counted = re.search(r'(\d+) read by now', said)
    if counted is not None:
        del readings[: len(readings) + 1 - int(counted[1])]
    readings.append(f'{load}: {said}')

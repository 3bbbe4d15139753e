# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog of the dynamic setting, with passes at each belt speed, training, and the accuracy."""

from pathlib import Path

from checkweigher_msgs.msg import DynamicSetting
from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_web.elements import Table
from checkweigher_web.work.dialogs import Desk, Guide, field, number_in, reason_field
from checkweigher_web.work.services import ActionRefusedError, LaneServices

_PERIOD = 0.2  # s
_MANY = 100_000  # upper limit of the number of passes, exclusive
_STEPS = (
    'Set a belt speed, record passes of one known mass, and let that product pass as often; then '
    'the same at the next speed. Train on all that was recorded: it takes minutes, and the line '
    'weighs on. The table then tells how accurate each estimator was on passes that it was not '
    'trained on. The line keeps its parameters until you take the trained ones over, and uses them '
    'once it is started again; the file before is kept. To close this dialog ends nothing.'
)
_STATES = {
    DynamicSetting.RECORDING: 'recording',
    DynamicSetting.TUNING: 'training',
    DynamicSetting.FAILED: 'failed',
}
_ENDINGS = {DynamicSetting.RECORDING: 'End recording', DynamicSetting.TUNING: 'End training'}
_HEADS = 'estimator', 'm/min', 'passes', 'A trained g', 'A held out g'


class DynamicSettingGuide(Guide):
    """Dialog of the dynamic setting, which continues when the dialog is closed."""

    title = 'Dynamic setting'
    needs = ports.SHOW_TUNED

    def __init__(self, desk: Desk, services: LaneServices) -> None:
        super().__init__(desk, services)
        self._said: DynamicSetting | None = None
        self._table: list[str] = []  # lines of the table of accuracy that the dialog shows
        with self.body:
            ui.label(_STEPS)
            self._mass = field('Mass', unit='g')
            self._passes = field('Passes', '60')
            self._state = ui.label('').classes('state').props('role=status')
            self._bags = ui.label('')
            with ui.element('div').classes('accuracy'):
                self._accuracy = Table(_HEADS)
            self._chosen = ui.label('')
            self.reason = reason_field(desk)
            ui.timer(_PERIOD, self._update)
        self.button('Record passes', self._record)
        self.button('Train', self._train)
        self._ending = self.button('End', self._end)
        self._taking = self.button('Take over', self._take_over)
        self._restarting = self.service_button(
            'Start the line again', 'start the line again', ports.RESTART_LINE
        )
        for button in (self._ending, self._taking, self._restarting):
            button.set_visibility(False)

    async def _update(self) -> None:
        said = self.services.setting
        if said is None or said is self._said:
            return
        self._said = said
        lines = await self._trained()
        if self._state.is_deleted:  # The user has closed the dialog.
            return
        self._show(lines)
        self._state.set_text(_state(said, waits=bool(lines)))
        bags = ', '.join(Path(bag).name for bag in said.bags)
        self._bags.set_text(f'Recorded: {bags or "nothing"}')
        ending = _ENDINGS.get(said.state, 'Drop' if lines else '')
        self._ending.set_text(ending)
        self._ending.set_visibility(bool(ending))
        self._taking.set_visibility(bool(lines))
        self._restarting.set_visibility(bool(said.file) and said.state == DynamicSetting.IDLE)

    async def _trained(self) -> list[str]:
        """Return the table of accuracy of parameters that wait to be accepted, or []."""
        try:
            return (await self.services.message(ports.SHOW_TUNED)).splitlines()
        except ActionRefusedError:
            return []

    def _show(self, lines: list[str]) -> None:
        self._table = lines
        chosen = [line for line in lines if line.startswith('chosen:')]
        self._accuracy.show(tuple(line.split()) for line in lines[1:] if line not in chosen)
        self._chosen.set_text('; '.join(chosen))

    async def _record(self) -> None:
        mass, passes = number_in(self._mass), number_in(self._passes)
        if not (passes.is_integer() and 0 < passes < _MANY):
            raise ActionRefusedError(f'Passes: {passes:g} is not a number of passes')

        async def record() -> str:
            values = {'mass': mass / GRAMS, 'passes': int(passes)}
            return str(
                (await self.services.do(ports.RECORD_PASSES, may_end=True, **values)).message
            )

        self.begin(f'record {passes:g} passes of {mass:g} g', record)

    async def _train(self) -> None:
        async def train() -> str:
            return str((await self.services.do(ports.TUNE_PASSES)).message)

        self.begin('train on the recorded passes', train)

    async def _end(self) -> None:
        seen = self._said

        async def end() -> str:
            now = self.services.setting
            if seen is None or now is None or now.state != seen.state:
                raise ActionRefusedError('it has ended already')
            return await self.services.message(ports.CANCEL_PASSES)

        await self.perform(f'{self._ending.text.lower()}, dynamic setting', end)

    async def _take_over(self) -> None:
        seen = self._table

        async def take_over() -> str:
            if await self._trained() != seen:
                raise ActionRefusedError('the trained parameters have changed: see the table again')
            return await self.services.message(ports.ACCEPT_TUNED)

        await self.perform('take over the trained parameters', take_over)


def _state(said: DynamicSetting, *, waits: bool) -> str:
    """Return the state as a text. `waits` is true if trained parameters wait to be accepted."""
    if said.state == DynamicSetting.IDLE:
        return 'trained: look at the table, then take it over or drop it' if waits else said.text
    counted = f', {said.passes} of {said.wanted} passes' if said.wanted else ''
    return f'{_STATES[said.state]}{counted}: {said.text}'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dynamic: passes of a known mass at each belt speed, training, and its accuracy."""

from functools import partial
import math

from checkweigher_msgs.msg import DynamicSetting
from nicegui import ui

from checkweigher_core.printable import counted
from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_web.commissioning.accuracy import matrix_of
from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.commissioning.wording import in_words
from checkweigher_web.elements import Lines, Table, scrolled
from checkweigher_web.words import grams
from checkweigher_web.work.dialogs import field, number_in
from checkweigher_web.work.services import ActionRefusedError

_MANY = 100_000  # upper limit of the number of passes, exclusive
_PHASES = {
    'reading': 'reading the passes',
    'preparing': 'preparing the estimators',
    'tuning': 'training',
}


class DynamicStep(Step):
    """Step of the dynamic setting, which continues after the user leaves the page."""

    title = 'Dynamic'
    to_do = (
        'Run the belt at a speed, type the known mass, record, and let that product pass as often. '
        'Do the same at each speed of production, with masses from both ends of the range too if '
        'these will be verified. Then train: the line goes on weighing meanwhile. What was trained '
        'is used after "Take over" and the next start of the line.'
    )

    def _build(self) -> None:
        self._said: DynamicSetting | None = None
        self._table: list[str] = []  # lines of the accuracy that the step shows
        self._taken = False
        with ui.element('div').classes('fields'):
            self._mass = field('Mass of the product', unit='g')
            self._passes = field('Passes', '60')
        self._state = ui.label('').classes('state').props('role=status')
        self._bar = ui.linear_progress(0, show_value=False, size='1rem')
        self._bar.props('instant-feedback aria-label="part that is done"')
        self._recorded = ui.label('').classes('about')
        self._changes = Lines().classes('lines changes').props('aria-label="now and after"')
        with scrolled('accuracy', 'accuracy'):
            self._accuracy = ui.element('div')
        self._show_table()

    def standing(self) -> Standing:
        """Return whether the line has trained parameters, or what is missing."""
        said = self.services.setting
        if said is None:
            return Standing(False, 'not available: the line was started without a folder')
        if said.state == DynamicSetting.RECORDING:
            return Standing(False, f'recording: {said.passes} of {said.wanted}')
        if said.state == DynamicSetting.TUNING:
            return Standing(False, 'training')
        if self._table:
            return Standing(False, 'trained, not taken over yet')
        done = 'taken over' + (': start the line again' if self._taken else '')
        return Standing(bool(said.file), done if said.file else 'not trained')

    async def update(self) -> None:
        """Show the progress, and the accuracy when it has changed."""
        said = self.services.setting
        if said is None:
            return
        share, text = self._progress(said)
        self._state.set_text(text)
        self._bar.set_value(share)
        self._bar.set_visibility(not math.isnan(share))
        if said is self._said:
            return
        self._said = said
        self._recorded.set_text(f'Recorded so far: {counted(len(said.bags), "recording")}')
        lines = await self._trained()
        if lines != self._table and not self._state.is_deleted:
            self._table = lines
            self._show_table()

    def _progress(self, said: DynamicSetting) -> tuple[float, str]:
        """Return the fraction that is done, or NaN if nothing runs, and a text on the state."""
        if said.state == DynamicSetting.RECORDING:
            text = f'{said.passes} of {said.wanted} passes of {grams(said.mass, " g", 2)}'
            return said.passes / max(said.wanted, 1), f'{text}: let the product pass'
        if said.state != DynamicSetting.TUNING:
            return math.nan, in_words(said.text) if said.state == DynamicSetting.FAILED else ''
        found = self.services.feedback.get(ports.TUNE_PASSES)
        if found is None or not found.text:
            return 0.0, 'training has begun'
        left = f', about {_time(found.remaining)} left' if found.remaining >= 0 else ''
        return float(found.progress), f'{_PHASES.get(found.text, found.text)}{left}'

    async def _trained(self) -> list[str]:
        """Return the accuracy of trained parameters that are not accepted yet, or []."""
        try:
            return (await self.services.message(ports.SHOW_TUNED)).splitlines()
        except ActionRefusedError:
            return []

    def _show_table(self) -> None:
        heads, rows, changes = matrix_of(self._table)
        self._changes.show(changes)
        self._changes.set_visibility(bool(changes))
        self._accuracy.clear()
        with self._accuracy:
            Table(heads).show(rows)

    def primary(self) -> Choice:
        """Return the button for the next action."""
        said = self.services.setting
        is_idle = said is not None and not self._works(said)
        if self._table:
            return Choice('Take over', self._take_over, is_idle)
        if self._taken:
            return Choice('Start the line again', self._restart, is_idle)
        return Choice('Record passes', self._record, is_idle)

    def others(self) -> tuple[Choice, ...]:
        """Return the buttons that end a running action, drop trained parameters, and train."""
        said = self.services.setting
        works = said is not None and self._works(said)
        has_passes = said is not None and bool(said.bags)
        return (
            Choice('End', self._end, works),
            Choice('Drop', self._drop, bool(self._table) and not works),
            Choice('Train', self._train, has_passes and not works),
        )

    @staticmethod
    def _works(said: DynamicSetting) -> bool:
        return said.state in (DynamicSetting.RECORDING, DynamicSetting.TUNING)

    async def _record(self) -> None:
        mass, passes = number_in(self._mass), number_in(self._passes)
        if not (passes.is_integer() and 0 < passes < _MANY):
            raise ActionRefusedError(f'Passes: {passes:g} is not a number of passes')

        async def record() -> str:
            goal = {'mass': mass / GRAMS, 'passes': int(passes)}
            answer = await self.services.do(ports.RECORD_PASSES, may_end=True, **goal)
            return str(answer.message)

        what = f'record {passes:g} passes of {mass:g} g'
        await self.begin(what, record, ports.RECORD_PASSES)

    async def _train(self) -> None:
        async def train() -> str:
            await self.services.do(ports.TUNE_PASSES)
            return 'trained: look at the accuracy, then take it over or drop it'

        await self.begin('train on the recorded passes', train, ports.TUNE_PASSES)

    async def _end(self) -> None:
        seen = self._said
        recording = seen is not None and seen.state == DynamicSetting.RECORDING
        name = ports.RECORD_PASSES if recording else ports.TUNE_PASSES
        end = partial(self.services.cancel, name)
        await self.perform(f'end {"recording" if recording else "training"}', end)

    async def _drop(self) -> None:
        async def drop() -> str:
            now = self.services.setting
            if now is None or self._works(now):  # the service would also end it
                raise ActionRefusedError('busy')
            await self.services.message(ports.CANCEL_PASSES)
            return 'dropped: the line keeps what it has'

        await self.perform('drop what was trained', drop)

    async def _take_over(self) -> None:
        seen = self._table

        async def take_over() -> str:
            if await self._trained() != seen:
                raise ActionRefusedError('it was trained again: look at the accuracy first')
            await self.services.message(ports.ACCEPT_TUNED)
            return 'taken over; the line uses it when it is started again'

        self._taken = await self.perform('take over the trained parameters', take_over)

    async def _restart(self) -> None:
        restart = partial(self.services.message, ports.RESTART_LINE)
        self._taken = not await self.perform('start the line again', restart)


def _time(seconds: float) -> str:
    return f'{seconds:.0f} s' if seconds < 90 else f'{seconds / 60:.0f} min'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning step Dynamic: passes of a known mass at each belt speed, and training."""

from functools import partial
from itertools import product
import math

from checkweigher_msgs.msg import DynamicSetting
from nicegui import ui

from checkweigher_core.ros import ports
from checkweigher_validation.verification.plan import MINUTE
from checkweigher_web.commissioning.accuracy import matrix_of
from checkweigher_web.commissioning.coverage import (
    Recorded,
    lines_of,
    loads_of,
    not_covered,
    recorded,
)
from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.elements import Lines, Table, named, scrolled
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.languages.wording import in_words
from checkweigher_web.work.actions import products
from checkweigher_web.work.dialogs import field, mass_in, number_in
from checkweigher_web.work.services import ActionRefusedError

# Duration in s of a training without passes, and additional duration in s for each pass. They are
# longer than those of `checkweigher tune` on two free cores, 120 passes at one speed and 360 at
# three (4 and 11 s), because the line needs a part of the processor.
_TRAINING, _TRAINING_OF_PASS = 3.0, 0.035
_MASSES = 2  # number of masses that a verification needs at least, close to Min and to Max
_MANY = 100_000  # upper bound of the number of passes, exclusive
_FOR_VERIFICATION = Text(
    'The plan of Verify begins with the masses and speeds that are recorded here. For a machine '
    'that will be verified, record a mass close to Min and one close to Max.'
)
_INDEX = Text(
    'Each value is the overall index A of the errors on passes that were not used for training: '
    '|mean error| + 3 standard deviations.'
)
_PHASES = {
    'reading': Text('reading the passes'),
    'preparing': Text('preparing the estimators'),
    'tuning': Text('training'),
}


class DynamicStep(Step):
    """Step of the dynamic setting: passes of known masses are recorded, and estimators trained.

    A recording or training continues after the user has left the page.
    """

    title = Text('Dynamic')
    to_do = Text(
        'Run the belt at a speed, type the known mass, record, and let that product pass as often. '
        'Do the same at each speed of production, and with the lightest and the heaviest mass that '
        'will be weighed or verified. Then train: the line goes on weighing meanwhile. What was '
        'trained is used after "Take over" and the next start of the line.'
    )

    def _build(self) -> None:
        self._said: DynamicSetting | None = None
        self._known: tuple[Recorded, ...] = ()  # recorded passes
        self._lacking: list[Text] = []  # lines on the passes that are not recorded yet
        self._products: list[float] = []  # nominal gross masses of the products in kg
        self._table: list[str] = []  # lines of the accuracy table on the page
        self._request = ''
        with ui.element('div').classes('fields'):
            self._mass = field(self.say('Mass of the product'), unit=self.say.unit)
            self._passes = field(self.say('Passes'), '60')
        self._bar = ui.linear_progress(0, show_value=False, size='1rem')
        named(self._bar.props('instant-feedback'), self.say('part that is done'))
        self._recorded = named(Lines().classes('lines'), self.say('recorded passes'))
        # Let the list take the keyboard focus, so that the arrow keys can scroll a long list.
        self._recorded.props('tabindex=0')
        self._doubts = named(Lines().classes('lines doubts'), self.say('not recorded yet'))
        self._changes = named(Lines().classes('lines changes'), self.say('now and after'))
        with scrolled('accuracy', self.say('accuracy')):
            self._accuracy = ui.element('div')
        self._show_table()

    def standing(self) -> Standing:
        """Return whether trained parameters have been taken over, and a text on the state.

        The step is not done while passes are recorded, while the estimators are trained, while
        newly trained parameters have been neither taken over nor dropped, or before the line was
        started with them.
        """
        said = self.services.setting
        if said is None:
            return Standing(False, Text('not available: the line was started without a folder'))
        if said.state == DynamicSetting.RECORDING:
            text = Text('recording: {count} of {wanted}', count=said.passes, wanted=said.wanted)
            return Standing(False, text)
        if said.state == DynamicSetting.TUNING:
            return Standing(False, Text('training'))
        if self._table:
            return Standing(False, Text('trained, not taken over yet'))
        if not said.file:
            return Standing(False, Text('not trained'))
        if self._is_waiting:
            return Standing(False, Text('taken over: start the line again'))
        return Standing(True, Text('taken over'))

    async def update(self) -> None:
        """Show the progress and the recorded passes, and also the accuracy if it has changed."""
        said = self.services.setting
        if said is None:
            return
        await self._show_coverage()
        share, self._request = self._progress(said)
        self._bar.set_value(share)
        self._bar.set_visibility(not math.isnan(share))
        if said is self._said:
            return
        self._said = said
        if self._works(said):  # Nothing new can be accepted before the recording or training ends.
            return
        lines = await self._trained()
        if lines != self._table and not self._bar.is_deleted:
            self._table = lines
            self._show_table()

    async def _show_coverage(self) -> None:
        """Show the recorded passes, and the loads to be weighed that these passes do not cover.

        The loads come from the verification plan, unless the plan is still the example, and from
        the recipes, whose masses are weighed at each recorded speed.
        """
        before, self._known = self._known, await recorded(self.services)
        if self._said is None or self._known != before:
            self._products = await self._masses_of_recipes()
        if self._bar.is_deleted:
            return
        speeds = {round(MINUTE * each.speed) / MINUTE for each in self._known}
        plan = self.services.plans.get(self.desk.person, '')
        loads = [*loads_of(plan), *product(speeds, self._products)]
        self._lacking = lines_of(not_covered(self._known, loads))
        self._recorded.show(self.say(_words(each)) for each in self._known)
        self._recorded.set_visibility(bool(self._known))
        if not plan and len({each.mass for each in self._known}) < _MASSES:
            self._lacking.insert(0, _FOR_VERIFICATION)
        self._doubts.show(map(self.say, self._lacking))
        self._doubts.set_visibility(bool(self._lacking))

    async def _masses_of_recipes(self) -> list[float]:
        try:
            known = await products(self.services)
        except ActionRefusedError:
            return []
        return [each.nominal + each.tare for each in known.values()]

    def _progress(self, said: DynamicSetting) -> tuple[float, str]:
        """Return the completed fraction of the running action, and a text on its progress.

        If no action runs, the fraction is NaN, and the text is the reason for a failure, or the
        expected duration of the training.
        """
        if said.state == DynamicSetting.RECORDING:
            text = Text(
                '{count} of {wanted} passes of {mass}: let the product pass',
                count=said.passes,
                wanted=said.wanted,
                mass=Mass(round(said.mass, 5)),
            )
            return said.passes / max(said.wanted, 1), text
        if said.state == DynamicSetting.FAILED:
            return math.nan, in_words(said.text)
        if said.state != DynamicSetting.TUNING:
            return math.nan, self._duration()
        found = self.services.feedback.get(ports.TUNE_PASSES)
        if found is None or not found.text:
            return 0.0, Text('training has begun')
        phase = _PHASES.get(found.text, found.text)
        if found.remaining < 0:
            return float(found.progress), phase
        text = Text('{phase}, about {time} left', phase=phase, time=_time(found.remaining))
        return float(found.progress), text

    def _duration(self) -> str:
        passes = sum(each.passes for each in self._known)
        if not passes or self._table or self._is_waiting or self.standing().is_done:
            return ''
        time = _time(10 * math.ceil((_TRAINING + passes * _TRAINING_OF_PASS) / 10))
        return Text(
            'Training on the {count} passes takes about {time} if the computer has little else '
            'to do',
            count=passes,
            time=time,
        )

    async def _trained(self) -> list[str]:
        """Return the lines of the accuracy table of trained parameters that are not accepted yet.

        Returns [] if there are no such parameters, or if the node does not answer.
        """
        try:
            return (await self.services.message(ports.SHOW_TUNED)).splitlines()
        except ActionRefusedError:
            return []

    def _show_table(self) -> None:
        heads, rows, changes = matrix_of(self._table, self.say)
        self._changes.show(changes)
        self._changes.set_visibility(bool(changes))
        self._accuracy.clear()
        with self._accuracy:
            if rows:
                ui.label(self.say(_INDEX))
            Table(heads).show(rows)

    def request(self) -> str:
        """Return the progress of the running action, or the expected duration of the training."""
        return self._request

    def primary(self) -> Choice:
        """Return the button for the next action.

        The button accepts trained parameters if there are any, otherwise restarts the line if
        parameters were accepted since its start, and otherwise records passes or trains.
        """
        said = self.services.setting
        is_idle = said is not None and not self._works(said)
        if self._table:
            return Choice(Text('Take over'), self._take_over, is_idle)
        if self._is_waiting:
            return Choice(Text('Start the line again'), self._restart, is_idle)
        return self._recording_and_training()[0]

    def others(self) -> tuple[Choice, ...]:
        """Return the buttons that end a running action, discard trained parameters, and train.

        If the primary button trains, the last of these buttons records further passes instead.
        """
        said = self.services.setting
        works = said is not None and self._works(said)
        return (
            Choice(Text('End'), self._end, works),
            Choice(Text('Drop'), self._drop, bool(self._table) and not works),
            self._recording_and_training()[1],
        )

    def _recording_and_training(self) -> tuple[Choice, Choice]:
        """Return the buttons that record passes and train, the next action first."""
        said = self.services.setting
        is_idle = said is not None and not self._works(said)
        has_passes = said is not None and bool(said.bags)
        record = Choice(Text('Record passes'), self._record, is_idle)
        train = Choice(Text('Train'), self._train, has_passes and is_idle)
        is_next = bool(self._known) and not self._lacking and not self.standing().is_done
        is_next = (is_next and not self._table) or self._is_waiting
        return (train, record) if is_next else (record, train)

    @property
    def _is_waiting(self) -> bool:
        """Whether parameters were taken over, and the line was not started again since then.

        Each start of the line publishes a new record of the load cell.
        """
        taken = self.services.taken
        return taken is not None and taken is self.lane.load_cell

    @staticmethod
    def _works(said: DynamicSetting) -> bool:
        return said.state in (DynamicSetting.RECORDING, DynamicSetting.TUNING)

    async def _record(self) -> None:
        mass, passes = mass_in(self._mass, self.say), number_in(self._passes, self.say)
        if not (passes.is_integer() and 0 < passes < _MANY):
            number = self.say.entry(passes)
            raise ActionRefusedError(
                Text('Passes: {number} is not a number of passes', number=number)
            )

        async def record() -> str:
            goal = {'mass': mass, 'passes': int(passes)}
            answer = await self.services.do(ports.RECORD_PASSES, may_end=True, **goal)
            return str(answer.message)

        what = Text('record {count} passes of {mass}', count=int(passes), mass=Mass(mass))
        await self.begin(what, record, ports.RECORD_PASSES)

    async def _train(self) -> None:
        async def train() -> str:
            await self.services.do(ports.TUNE_PASSES)
            return Text('trained: look at the accuracy, then take it over or drop it')

        await self.begin(Text('train on the recorded passes'), train, ports.TUNE_PASSES)

    async def _end(self) -> None:
        seen = self._said
        recording = seen is not None and seen.state == DynamicSetting.RECORDING
        name = ports.RECORD_PASSES if recording else ports.TUNE_PASSES
        end = partial(self.services.cancel, name)
        what = Text('end recording') if recording else Text('end training')
        await self.perform(what, end)

    async def _drop(self) -> None:
        async def drop() -> str:
            now = self.services.setting
            # Refuse to drop the parameters while an action runs, because the service would cancel
            # the action.
            if now is None or self._works(now):
                raise ActionRefusedError('busy')
            await self.services.message(ports.CANCEL_PASSES)
            return Text('dropped: the line keeps what it has')

        await self.perform(Text('drop what was trained'), drop)

    async def _take_over(self) -> None:
        seen = self._table

        async def take_over() -> str:
            if await self._trained() != seen:
                raise ActionRefusedError(Text('it was trained again: look at the accuracy first'))
            await self.services.message(ports.ACCEPT_TUNED)
            return Text('taken over; the line uses it when it is started again')

        what = Text('take over the trained parameters')
        if await self.perform(what, take_over):
            self.services.taken = self.lane.load_cell
            self._table = []
            self._show_table()

    async def _restart(self) -> None:
        restart = partial(self.services.message, ports.RESTART_LINE)
        await self.perform(Text('start the line again'), restart)


def _words(known: Recorded) -> Text:
    speed = round(MINUTE * known.speed)
    return Text(
        '{count} passes of {mass} at {speed} m/min',
        count=known.passes,
        mass=Mass(round(known.mass, 6)),
        speed=speed,
    )


def _time(seconds: float) -> str:
    return f'{seconds:.0f} s' if seconds < 90 else f'{seconds / 60:.0f} min'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The verification in steps: a plan, then one step after the other, and the report at the end."""

from collections.abc import Iterator
from functools import partial
import json
from pathlib import Path

from nicegui import ui

from checkweigher_core.input_files import read_input
from checkweigher_core.parameters import ParameterError
from checkweigher_core.printable import counted
from checkweigher_core.records import ProgressState, StepAnswer, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_validation.verification.plan import (
    EXAMPLE,
    LONGEST,
    PLANS,
    VERIFICATIONS,
    read_plan,
)
from checkweigher_validation.verification.steps import Step, steps_of
from checkweigher_web.access.users import Role
from checkweigher_web.elements import Table
from checkweigher_web.work.dialogs import Action, Desk, Dialog
from checkweigher_web.work.reports import VERIFICATION, list_reports
from checkweigher_web.work.services import LaneServices, Outcome

_ROLE = Role.TECHNICIAN
_PERIOD = 0.2  # s
_MANY = 10  # verifications in the list
_EXAMPLE = 'example'
_STEPS = (
    'Choose a plan, look at its steps, and begin. You are asked for one step after another; a step '
    'that failed may be made again, and one is skipped with a reason, which the report has. To '
    'close this dialog ends nothing.'
)
_STATES = {
    ProgressState.ASKING: 'do this, then press Make: ',
    ProgressState.DECIDING: 'failed: make it again, or go on? ',
}
# The browser reads the file; what is longer is no plan, and is refused as such.
_READ = f'(event) => event.target.files[0]?.slice(0, {4 * LONGEST}).text().then(t => emit(t))'


async def verify(desk: Desk, services: LaneServices) -> None:
    """Guide through a verification, from where it stands."""
    await services.found(ports.BEGIN_VERIFICATION)
    Guide(desk, services)


class Guide:
    """The dialog of a verification, which goes on without it."""

    def __init__(self, desk: Desk, services: LaneServices) -> None:
        self._desk = desk
        self._services = services
        self._said: VerificationProgress | None = None
        self._paths: dict[str, Path] = {}  # of the plans, by their names in the folder
        self._dialog = Dialog('Verification')
        with self._dialog.body:
            ui.label(_STEPS)
            self._choice = ui.element('div').classes('fields')
            with self._choice:
                self._plans = ui.select([], label='Plan', on_change=self._take_chosen)
                self._plans.props('outlined dense')
                upload = ui.element('input').props('type=file aria-label="Plan from a file"')
                upload.on('change', lambda event: self._take(str(event.args)), js_handler=_READ)
                self._plan = ui.textarea('Text of the plan', on_change=self._show_plan)
                self._plan.props('outlined dense debounce=300').classes('plan')
                # Apart from the state of the verifier, which may be heard after a plan is chosen.
                self._found = ui.label('').classes('found').props('role=status')
            self._state = ui.label('').classes('state').props('role=status')
            self._lines = ui.element('ul').classes('read lines')
            self._lines.props('tabindex=0 aria-label="what came in this step, the latest first"')
            with ui.element('div').classes('steps').props('tabindex=0 aria-label="steps"'):
                self._table = Table(('step', 'what to do, or the result'))
            self._reports = ui.element('ol').classes('reports').props('aria-label="reports"')
            self._reason = ui.input('Reason (needed to skip a step)')
            self._reason.props('outlined dense maxlength=200')
            ui.timer(_PERIOD, self._update)
        self._dialog.closing.set_text('Close')
        self._begin = self._dialog.button('Begin', self._do_begin)
        self._break = self._dialog.button('Break off', self._do_break_off)
        self._skip = self._dialog.button('Skip', partial(self._answer, StepAnswer.SKIP, 'skip'))
        going_on = partial(self._answer, StepAnswer.GO_ON, 'go on after')
        self._leave = self._dialog.button('Go on', going_on)
        self._make = self._dialog.button('Make', partial(self._answer, StepAnswer.MAKE, 'make'))
        self._update()

    # What is shown

    def _update(self) -> None:
        """Show how far it is."""
        said = self._services.verification
        if said is None or said is self._said:
            return
        before, self._said = self._said, said
        idle = said.state is ProgressState.IDLE
        self._choice.set_visibility(idle)
        self._begin.set_visibility(idle)
        self._break.set_visibility(not idle)
        self._skip.set_visibility(said.state is ProgressState.ASKING)
        self._leave.set_visibility(said.state is ProgressState.DECIDING)
        self._make.set_visibility(said.state in _STATES)
        at = f'{said.step + 1}/{len(said.steps)} {said.steps[said.step]}: ' if said.steps else ''
        self._state.set_text(f'{"" if idle else at}{_STATES.get(said.state, "")}{said.text}')
        if before is None or before.lines != said.lines:
            self._lines.clear()
            for line in reversed(said.lines):
                with self._lines, ui.element('li'):
                    ui.label(line)
        # The table has the steps of a plan that was chosen before the verifier was heard.
        chosen = before is None and idle and self._plan.value
        if said.steps and not chosen:
            self._table.show(zip(said.steps, said.results, strict=True))
        if idle and (before is None or before.state is not ProgressState.IDLE):
            self._show_choices(Path(said.folder))

    def _show_choices(self, folder: Path) -> None:
        """Show the plans that there are on this machine, and the reports."""
        made = sorted((folder / VERIFICATIONS).glob('*/plan.yaml'), reverse=True)[:_MANY]
        known = [*sorted((folder / PLANS).glob('*.yaml')), *made]
        self._paths = {str(path.relative_to(folder)): path for path in known}
        self._plans.set_options([*self._paths, _EXAMPLE])
        self._reports.clear()
        with self._reports:
            list_reports(self._desk.lane.name, VERIFICATION, _made(path.parent for path in made))

    def _take_chosen(self) -> None:
        name = self._plans.value
        if name == _EXAMPLE:
            self._take(EXAMPLE)
        elif name in self._paths:
            try:
                self._take(read_input(self._paths[name]).decode('utf-8'))
            except (OSError, UnicodeDecodeError) as error:
                self._dialog.tell(Outcome(False, f'{name}: {error}'))

    def _take(self, text: str) -> None:
        self._plan.set_value(text)

    def _show_plan(self) -> None:
        """Show the steps of the plan, or what is wrong with it."""
        try:
            steps = steps_of(read_plan(str(self._plan.value or '')))
        except ParameterError as error:
            self._found.set_text(f'the plan: {error}')
            self._table.show([])
            return
        self._found.set_text(counted(len(steps), 'step'))
        self._table.show((step.name, _asked(step)) for step in steps)

    # What is done

    async def _do_begin(self) -> None:
        text = str(self._plan.value or '')
        begin = partial(self._services.message, ports.BEGIN_VERIFICATION, plan=text)
        await self._perform('begin verification', begin)

    async def _answer(self, answer: StepAnswer, verb: str) -> None:
        """Answer what this person sees, not what is asked by now."""
        seen, reason = self._said, str(self._reason.value or '')
        if seen is None or not seen.steps:
            return

        async def give() -> str:
            await self._services.call(
                ports.ANSWER_VERIFICATION, question=seen.question, answer=int(answer),
                reason=reason,
            )  # fmt: skip
            return f'{seen.steps[seen.step]}: taken'

        what = f'{verb} step {seen.steps[seen.step]} of verification {seen.name}'
        if await self._perform(what, give):
            self._reason.set_value('')

    async def _do_break_off(self) -> None:
        end = partial(self._services.message, ports.CANCEL_VERIFICATION)
        await self._perform('break off verification', end)

    async def _perform(self, what: str, action: Action) -> bool:
        return await self._dialog.perform(self._desk, _ROLE, what, self._reason, action)


def _asked(step: Step) -> str:
    """Return what a step asks for, in words."""
    return f'{step.count} passes: {step.to_do}' if step.count else step.to_do


def _made(folders: Iterator[Path]) -> Iterator[tuple[str, str]]:
    """Yield the verifications that have a report, each by its name and with its verdict."""
    for folder in folders:
        try:
            verdict = json.loads((folder / 'report.json').read_bytes())['verdict']
        except (OSError, ValueError, KeyError, TypeError):
            continue
        yield folder.name, f'{folder.name} {verdict}'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog of a verification, with the choice of a plan, the steps, and links to the reports."""

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
from checkweigher_web.elements import Lines, Table
from checkweigher_web.work.dialogs import Desk, Guide, field
from checkweigher_web.work.reports import VERIFICATION, list_reports
from checkweigher_web.work.services import LaneServices, Outcome

_PERIOD = 0.2  # s
_MANY = 10  # maximum number of verifications in the list
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
# The browser reads only the start of a file that is too long for a plan.
_READ = f'(event) => event.target.files[0]?.slice(0, {4 * LONGEST}).text().then(t => emit(t))'


class VerificationGuide(Guide):
    """Dialog of a verification, which continues when the dialog is closed."""

    title = 'Verification'
    needs = ports.ANSWER_VERIFICATION

    def __init__(self, desk: Desk, services: LaneServices) -> None:
        super().__init__(desk, services)
        self._said: VerificationProgress | None = None
        self._paths: dict[str, Path] = {}  # plans by their relative paths in the folder
        with self.body:
            ui.label(_STEPS)
            with ui.element('div').classes('fields') as self._choice:
                self._plans = ui.select([], label='Plan', on_change=self._read_chosen)
                self._plans.props('outlined dense')
                upload = ui.element('input').props('type=file aria-label="Plan from a file"')
                self._plan = ui.textarea('Text of the plan', on_change=self._show_plan)
                self._plan.props('outlined dense debounce=300').classes('plan')
                upload.on(
                    'change', lambda event: self._plan.set_value(str(event.args)), js_handler=_READ
                )
                # The state of the verifier does not replace this text, because a message of the
                # verifier may arrive after the user has chosen a plan.
                self._found = ui.label('').classes('found').props('role=status')
            self._state = ui.label('').classes('state').props('role=status')
            self._lines = Lines().classes('read lines')
            self._lines.props('tabindex=0 aria-label="what came in this step, the latest first"')
            with ui.element('div').classes('steps').props('tabindex=0 aria-label="steps"'):
                self._table = Table(('step', 'what to do, or the result'))
            self._reports = ui.element('ol').classes('reports').props('aria-label="reports"')
            self.reason = field('Reason (needed to skip a step)')
            ui.timer(_PERIOD, self._update)
        self._begin = self.button('Begin', self._do_begin)
        end = partial(services.cancel, ports.RUN_VERIFICATION)
        what = 'break off verification'
        self._break = self.button('Break off', partial(self.perform, what, end))
        self._skip = self.button('Skip', partial(self._answer, StepAnswer.SKIP, 'skip'))
        self._leave = self.button('Go on', partial(self._answer, StepAnswer.GO_ON, 'go on after'))
        self._make = self.button('Make', partial(self._answer, StepAnswer.MAKE, 'make'))
        self._update()

    # What is shown

    def _update(self) -> None:
        said, before = self.services.verification, self._said
        if said is None or said is before:
            return
        self._said = said
        self._state.set_text(_state(said))
        self._lines.show(reversed(said.lines))
        # If the user chose a plan before the first message of the verifier, the table shows it.
        chosen = before is None and said.state is ProgressState.IDLE and self._plan.value
        if said.steps and not chosen:
            self._table.show(zip(said.steps, said.results, strict=True))
        if before is None or before.state is not said.state:
            self._show_elements(said.state, Path(said.folder))

    def _show_elements(self, state: ProgressState, folder: Path) -> None:
        idle = state is ProgressState.IDLE
        for element, shown in (
            (self._choice, idle),
            (self._begin, idle),
            (self._break, not idle),
            (self._skip, state is ProgressState.ASKING),
            (self._leave, state is ProgressState.DECIDING),
            (self._make, state in _STATES),
        ):
            element.set_visibility(shown)
        if idle:
            self._show_choices(folder)

    def _show_choices(self, folder: Path) -> None:
        made = sorted((folder / VERIFICATIONS).glob('*/plan.yaml'), reverse=True)[:_MANY]
        known = [*sorted((folder / PLANS).glob('*.yaml')), *made]
        self._paths = {str(path.relative_to(folder)): path for path in known}
        self._plans.set_options([*self._paths, _EXAMPLE])
        self._reports.clear()
        with self._reports:
            list_reports(self.desk.lane.name, VERIFICATION, _made(path.parent for path in made))

    def _read_chosen(self) -> None:
        name = self._plans.value
        if name == _EXAMPLE:
            self._plan.set_value(EXAMPLE)
        elif name in self._paths:
            try:
                self._plan.set_value(read_input(self._paths[name]).decode('utf-8'))
            except (OSError, UnicodeDecodeError) as error:
                self.tell(Outcome(False, f'{name}: {error}'))

    def _show_plan(self) -> None:
        steps: tuple[Step, ...] = ()
        try:
            steps = steps_of(read_plan(str(self._plan.value or '')))
            self._found.set_text(counted(len(steps), 'step'))
        except ParameterError as error:
            self._found.set_text(f'the plan: {error}')
        self._table.show(
            (step.name, f'{step.count} passes: {step.to_do}' if step.count else step.to_do)
            for step in steps
        )

    # What is done

    async def _do_begin(self) -> None:
        plan = str(self._plan.value or '')

        async def verify() -> str:
            return str((await self.services.do(ports.RUN_VERIFICATION, plan=plan)).message)

        self.begin('begin verification', verify)

    async def _answer(self, answer: StepAnswer, verb: str) -> None:
        """Answer the question that the dialog shows. The verifier refuses an outdated answer."""
        seen, reason = self._said, str(self.reason.value or '')
        if seen is None or not seen.steps:
            return
        step, question = seen.steps[seen.step], seen.question

        async def give() -> str:
            await self.services.call(
                ports.ANSWER_VERIFICATION, question=question, answer=int(answer), reason=reason
            )
            return f'{step}: taken'

        if await self.perform(f'{verb} step {step} of verification {seen.name}', give):
            self.reason.set_value('')


def _state(said: VerificationProgress) -> str:
    if said.state is ProgressState.IDLE:
        return said.text
    at = f'{said.step + 1}/{len(said.steps)} {said.steps[said.step]}: ' if said.steps else ''
    return f'{at}{_STATES.get(said.state, "")}{said.text}'


def _made(folders: Iterator[Path]) -> Iterator[tuple[str, str]]:
    """Yield the name of each verification with a report, and a text with the verdict."""
    for folder in folders:
        try:
            verdict = json.loads((folder / 'report.json').read_bytes())['verdict']
        except (OSError, ValueError, KeyError, TypeError):
            continue
        yield folder.name, f'{folder.name} {verdict}'

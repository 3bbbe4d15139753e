# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning step Verify: plan, steps and reports of a verification."""

from collections.abc import Iterator
from functools import partial
import json
from pathlib import Path

from nicegui import ui

from checkweigher_core.input_files import read_input
from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import LoadCell, ProgressState, StepAnswer, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_validation.verification.plan import LONGEST, PLANS, VERIFICATIONS
from checkweigher_web.commissioning.coverage import (
    Recorded,
    lines_of,
    loads_of,
    not_covered,
    recorded,
    usual_spacing,
)
from checkweigher_web.commissioning.plan_form import (
    TESTS,
    Field,
    chosen_tests,
    fields_of,
    new_plan,
    with_test,
    with_value,
    without_mass,
)
from checkweigher_web.commissioning.plan_summary import (
    LineFacts,
    departure_words,
    step_words,
    summary,
    to_do_of,
)
from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.elements import (
    Lines,
    Table,
    named,
    scrolled,
    text_file_input,
    told,
)
from checkweigher_web.languages.language import Text
from checkweigher_web.languages.wording import from_node, in_words
from checkweigher_web.work.dialogs import field
from checkweigher_web.work.reports import VERIFICATION, list_reports
from checkweigher_web.work.services import Outcome

# Number of masses after which the uncertainties of the plan are predicted again.
_EACH = 20
_MANY = 10  # maximum number of verifications in the list
_EXAMPLE = Text('example')
_STATES = {
    ProgressState.ASKING: Text('Do this, then press "Make it": {text}'),
    ProgressState.DECIDING: Text(
        'Failed. "Go on" keeps this result; after another attempt, the verdict is undecided at '
        'best. {text}'
    ),
}
_LONGEST_FILE = 4 * LONGEST  # maximum number of bytes that are read from a plan file


class VerifyStep(Step):
    """Step of the verification, which continues after the user leaves the page."""

    title = Text('Verify')
    to_do = Text(
        'Fill in the plan, and see below whether each test can be decided. Then begin: you are '
        'asked for one step after another. A step that failed may be made again; one is skipped '
        'with a reason, which the report has.'
    )

    def _build(self) -> None:
        say = self.say
        self._said: VerificationProgress | None = None
        self._shown, self._to_do = '', dict[str, str]()  # verification in the table, its steps
        self._known: tuple[Recorded, ...] = ()  # recorded passes
        self._zero = self.lane.zero  # latest zero that an operator has set.
        self._weighed = 0  # number of masses since the line was started, divided by `_EACH`
        # Plan files, by their paths relative to `VerificationProgress.folder`.
        self._paths: dict[str, Path] = {}
        self._found = ui.label('').classes('found').props('role=status')
        self._doubts = named(Lines().classes('lines doubts'), say('cannot be decided'))
        with ui.element('div').classes('fields') as self._choice:
            self._plans = ui.select(self._named(), label=say('Plan'), on_change=self._read_chosen)
            self._plans.props('outlined dense')
            text_file_input(say('Plan from a file'), _LONGEST_FILE, self._show_text)
            self._form = ui.element('div').classes('form')
            with ui.expansion(say('The plan as text, for experts')).classes('expert'):
                self._plan = ui.textarea(say('Text of the plan'), on_change=self._edit)
                self._plan.props('outlined dense debounce=300').classes('plan')
        self._lines = Lines().classes('read lines')
        named(self._lines.props('tabindex=0'), say('what came in this step, the latest first'))
        with scrolled('steps', say('steps')):
            self._table = Table((say('step'), say('what to do, or the result')))
        self._reports = ui.element('ol').classes('reports')
        named(self._reports, say('reports'))
        self._given = self._plan_facts()  # facts from which the new plan was made
        self._new = new_plan(*self._given)
        self._show_text(self.services.plans.get(self.desk.person) or self._new)

    def _plan_facts(
        self,
    ) -> tuple[str, LoadCell | None, tuple[Recorded, ...], dict[float, float], float]:
        """Return the arguments of `new_plan`, which may change while the page is open."""
        known = dict(self.services.uncertainties)
        return self.desk.person, self.lane.load_cell, self._known, known, self._zero_std_dev

    @property
    def _zero_std_dev(self) -> float:
        """Standard deviation in kg of the latest zero that an operator has set, or 0."""
        return self.lane.zero.std_dev if self.lane.zero else 0.0

    def standing(self) -> Standing:
        """Return whether the last verification has passed, and a text with its verdict.

        While a verification runs, the step is not done, and the text contains the progress.
        """
        said = self.services.verification
        if said is None:
            return Standing(False, Text('not available: the line was started without a folder'))
        if said.state is not ProgressState.IDLE:
            return Standing(False, _progress(said))
        verdict = in_words(said.text) if said.text else Text('not verified')
        return Standing(said.text.endswith(': passed'), verdict)

    # Plan

    def _read_chosen(self) -> None:
        name = str(self._plans.value)
        try:
            path = self._paths.get(name)
            self._show_text(self._new if path is None else read_input(path).decode('utf-8'))
        except (OSError, UnicodeDecodeError) as error:
            self.tell(Outcome(False, f'{name}: {error}'))

    def _edit(self) -> None:
        if (text := str(self._plan.value or '')) != self._text:
            self._show_text(text)

    def _show_text(self, text: str) -> None:
        """Show the text of a plan, and its values in the form, or no form for an invalid text."""
        self._store(text)
        self._plan.set_value(text)
        self._form.clear()
        try:
            fields, tests = fields_of(text, self.say), chosen_tests(text)
        except ParameterError:  # Show no form, because the summary shows the error.
            fields, tests = [], set()
        with self._form:
            masses = sum(entry.path[-1] == 'mass_g' for entry, _ in fields)
            for entry, value in fields:
                self._add_field(entry, value)
                if masses > 1 and entry.path[0] == 'references' and entry.path[-1] == 'serial':
                    name = entry.path[1]
                    label = self.say('Leave out {name}', name=name)
                    ui.button(label, on_click=partial(self._leave_out, name)).props('flat no-caps')
            for key, name in TESTS.items() if fields else ():
                made = ui.checkbox(self.say(name), value=key in tests)
                made.on_value_change(partial(self._set_test, key))
        self._show_summary(has_new_text=True)

    def _add_field(self, entry: Field, value: str) -> None:
        change = partial(self._set_value, entry.path)
        if not entry.choices:
            shown = field(self.say(entry.label), value, entry.unit).props('debounce=300')
            shown.on_value_change(change)
            if entry.path[-1] == 'mass_g':
                shown.classes('row-begins')
            return
        known = value if value in entry.choices else None
        choice = ui.select(
            list(entry.choices), label=self.say(entry.label), value=known, on_change=change
        )
        choice.props('outlined dense')

    def _set_value(self, path: tuple[str, ...], event: object) -> None:
        value = str(getattr(event, 'value', '') or '')
        self._change(with_value(self._text, path, value, self.say))

    def _set_test(self, key: str, event: object) -> None:
        self._change(with_test(self._text, key, made=bool(getattr(event, 'value', False))))

    def _leave_out(self, name: str) -> None:
        self._show_text(without_mass(self._text, name))

    def _store(self, text: str) -> None:
        """Store a plan for this page, and also for the user if it differs from a new plan."""
        self._text = text
        self.services.plans[self.desk.person] = '' if text == self._new else text

    def _change(self, text: str) -> None:
        self._store(text)
        self._plan.set_value(text)
        self._show_summary(has_new_text=True)

    def _show_summary(self, *, has_new_text: bool = False) -> None:
        """Show the summary of the plan, and also its steps if its text is new."""
        known = self._known
        line, rows, doubts = summary(self._text, self._facts())
        doubts += lines_of(not_covered(known, loads_of(self._text))) if known else []
        self._found.set_text(self.say(line))
        self._doubts.show(map(self.say, doubts))
        self._doubts.set_visibility(bool(doubts) and self._choice.visible)
        if has_new_text and self._choice.visible:  # otherwise, the table may show results
            self._table.show([self.say(step), told(to_do, self.say)] for step, to_do in rows)

    def _facts(self) -> LineFacts:
        """Return the facts about the line from which the result of the plan is predicted."""
        lane, spacing = self.lane, usual_spacing(self._known)
        return LineFacts(lane.load_cell, lane.usual_std_dev, self._zero_std_dev, spacing)

    # Procedure

    async def update(self) -> None:
        """Show the progress, and check the plan again after new passes, masses or a new zero."""
        await self._check_again()
        said, before = self.services.verification, self._said
        if said is None or said is before:
            return
        self._said = said
        is_idle = said.state is ProgressState.IDLE
        lines = said.lines if is_idle else reversed(said.lines)  # the end shows the departures
        self._lines.show(self.say(departure_words(line)) for line in lines)
        if not (is_idle and before is None):
            self._show_results(said)
        if before is None or before.state is not said.state:
            for element in (self._choice, self._found, self._doubts):
                element.set_visibility(is_idle)
            if is_idle:
                self._show_summary()
                self._show_choices(Path(said.folder))

    async def _check_again(self) -> None:
        now = await recorded(self.services), self.lane.zero, self.lane.weighed // _EACH
        if now != (self._known, self._zero, self._weighed) and not self._lines.is_deleted:
            self._known, self._zero, self._weighed = now
            if self._choice.visible:
                self._show_summary()
        if (given := self._plan_facts()) != self._given:
            before, self._given, self._new = self._new, given, new_plan(*given)
            if self._text == before != self._new:
                self._show_text(self._new)

    def _show_results(self, said: VerificationProgress) -> None:
        if not said.steps:
            return
        if said.name != self._shown:  # The page may have another plan than this verification.
            self._shown, self._to_do = said.name, _to_do(said)
        to_do = self._to_do
        self._table.show(
            (self.say(step_words(step)), told(from_node(result) or to_do.get(step, ''), self.say))
            for step, result in zip(said.steps, said.results, strict=True)
        )

    def _show_choices(self, folder: Path) -> None:
        made = sorted((folder / VERIFICATIONS).glob('*/plan.yaml'), reverse=True)[:_MANY]
        known = [*sorted((folder / PLANS).glob('*.yaml')), *made]
        self._paths = {str(path.relative_to(folder)): path for path in known}
        self._plans.set_options(self._named())
        self._reports.clear()
        with self._reports:
            list_reports(self.lane.name, VERIFICATION, _made(path.parent for path in made))

    def _named(self) -> dict[str, str]:
        """Return the label of each plan that can be chosen, by its path.

        The key of the example plan, which has no path, is its English label.
        """
        return {**{path: path for path in self._paths}, str(_EXAMPLE): self.say(_EXAMPLE)}

    def request(self) -> str:
        """Return what the user must do for the present step, or the last verdict."""
        return '' if self._said is None else _request(self._said)

    def primary(self) -> Choice:
        """Return the button that begins a verification or, while one runs, the requested step.

        After a failure, the button requests the failed step again, whose instruction then comes.
        """
        said = self.services.verification
        if said is None or said.state is ProgressState.IDLE:
            return Choice(Text('Begin'), self._begin, said is not None)
        what = Text('make step {step} of verification {name}')
        make = partial(self._answer, StepAnswer.MAKE, what)
        is_again = said.state is ProgressState.DECIDING
        label = Text('Make it again') if is_again else Text('Make it')
        return Choice(label, make, said.state in _STATES)

    def others(self) -> tuple[Choice, ...]:
        """Return the buttons that end the verification, skip a step, and go on after a failure."""
        state = self._said.state if self._said else ProgressState.IDLE
        skipped = Text('skip step {step} of verification {name}')
        left = Text('go on after step {step} of verification {name}')
        skip = partial(self._answer, StepAnswer.SKIP, skipped)
        leave = partial(self._answer, StepAnswer.GO_ON, left)
        return (
            Choice(Text('Break off'), self._break_off, state is not ProgressState.IDLE),
            Choice(Text('Skip'), skip, state is ProgressState.ASKING),
            Choice(Text('Go on'), leave, state is ProgressState.DECIDING),
        )

    async def _begin(self) -> None:
        async def verify() -> str:
            answer = await self.services.do(ports.RUN_VERIFICATION, plan=self._text)
            verdict = str(answer.message)
            return Text('the verification has ended: {verdict}', verdict=verdict)

        await self.begin(Text('begin verification'), verify, ports.RUN_VERIFICATION)

    async def _break_off(self) -> None:
        end = partial(self.services.cancel, ports.RUN_VERIFICATION)
        await self.perform(Text('break off verification'), end)

    async def _answer(self, answer: StepAnswer, what: Text) -> None:
        """Send the user's answer to the question that the page shows, if there is one.

        The verifier refuses the answer if it has asked another question in the meantime.
        """
        seen = self._said
        if seen is None or not seen.steps:
            return
        step, question, reason = seen.steps[seen.step], seen.question, self._reason()

        async def give() -> str:
            await self.services.call(
                ports.ANSWER_VERIFICATION, question=question, answer=int(answer), reason=reason
            )
            return ''

        await self.perform(Text(what.template, step=step, name=seen.name), give)


def _progress(said: VerificationProgress) -> Text:
    if not said.steps:
        return Text('begins')
    return Text('step {step} of {count}', step=said.step + 1, count=len(said.steps))


def _request(said: VerificationProgress) -> str:
    if said.state is ProgressState.IDLE or not said.steps:
        return in_words(said.text)
    name = said.steps[said.step]
    words = step_words(name)
    text = from_node(said.text.replace(name, words))
    if said.state in _STATES:
        text = Text(_STATES[said.state].template, text=text)
    return Text(
        'Step {number} of {count}, {step}: {text}',
        number=said.step + 1,
        count=len(said.steps),
        step=words,
        text=text,
    )


def _to_do(said: VerificationProgress) -> dict[str, str]:
    """Return what to do in each step of a verification, or {} if its plan cannot be read."""
    path = Path(said.folder) / VERIFICATIONS / said.name / 'plan.yaml'
    try:
        return to_do_of(read_input(path).decode('utf-8'))
    except (OSError, UnicodeDecodeError):
        return {}


def _made(folders: Iterator[Path]) -> Iterator[tuple[str, str]]:
    """Yield the name of each verification that has a report, and a text with its verdict."""
    for folder in folders:
        try:
            verdict = json.loads((folder / 'report.json').read_bytes())['verdict']
        except (OSError, ValueError, KeyError, TypeError):
            continue
        yield folder.name, f'{folder.name} {verdict}'

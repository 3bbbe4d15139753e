# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning page: list of steps, present load, panel of one step, simulated machine."""

from collections.abc import Callable
from functools import partial
import math
import time

from nicegui import ui

from checkweigher_core.records import MassEstimate
from checkweigher_validation.verification.plan import MINUTE
from checkweigher_web.commissioning.registry import STEPS
from checkweigher_web.commissioning.step import Choice, Standing, Step
from checkweigher_web.elements import STYLE, named, panel, show_told
from checkweigher_web.languages.language import Language, Text
from checkweigher_web.languages.wording import in_words
from checkweigher_web.technician.practice import PracticeView
from checkweigher_web.views.view import Look
from checkweigher_web.work.dialogs import Desk, reason_field, show_outcome
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome

_STYLE = STYLE.with_name('path.css')
_PERIOD = 0.5  # s
_AT_REST = 1e-4  # largest change of a load at rest within 1 s, in kg
_MOVES = 100  # change of the load at which the stability bar is empty, in multiples of `_AT_REST`


class CommissioningPath:
    """Commissioning page of one user.

    The buttons are at fixed places. If the label of a button changes, the button cannot be pressed
    until the next update, so that a double click does not also perform the new action.
    """

    def __init__(self, desk: Desk, services: LaneServices, look: Look) -> None:
        self._lane, self._say = desk.lane, desk.say
        say = desk.say
        ui.add_css(STYLE)
        ui.add_css(_STYLE)
        with ui.element('main').classes('path'):
            with named(ui.element('nav').classes('stages'), say('Steps')):
                self._tabs = [
                    _Tab(k, kind, partial(self._go, k), say) for k, kind in enumerate(STEPS)
                ]
            with panel(say('On the belt now'), 'now'):
                self._load = ui.label('').classes('load')
                self._steady = ui.linear_progress(0, show_value=False, size='1.25rem')
                named(self._steady.props('instant-feedback'), say('stability of the load'))
                self._moving = ui.label('')
                self._last = ui.label('')
            self._panels, self._standings = [], []
            self._steps: list[Step] = []
            for kind in STEPS:
                with panel(say(kind.title), f'stage {kind.title.lower()}') as shown:
                    self._standings.append(ui.label('').classes('standing'))
                    ui.label(say(kind.to_do))
                    self._steps.append(kind(desk, services, self._tell, self._given_reason))
                self._panels.append(shown)
            with panel(say(PracticeView.title), 'practice'):
                self._practice = PracticeView(look)
            with ui.element('div').classes('foot'):
                self._request = ui.label('').classes('request').props('role=status')
                self._result = ui.label('').classes('result').props('role=status')
                self._reason = reason_field(desk)
                with ui.element('div').classes('others'):
                    most = max(len(step.others()) for step in self._steps)
                    self._others = [self._button('outline') for _ in range(most)]
                    self._next = self._button('flat')
                self._primary = self._button('unelevated')
        self._go(0)
        ui.timer(_PERIOD, self._update)

    def _button(self, look: str) -> '_Button':
        return _Button(look, self._clear, self._tell, self._say)

    def _given_reason(self) -> str:
        return str(self._reason.value or '')

    def _go(self, number: int) -> None:
        self._at = number
        for k, (shown, tab) in enumerate(zip(self._panels, self._tabs, strict=True)):
            shown.set_visibility(k == number)
            tab.mark(is_current=k == number)
        self._clear()
        self._show_buttons()

    def _clear(self) -> None:
        self._result.set_text('')

    def _tell(self, outcome: Outcome) -> None:
        if self._result.is_deleted:  # The user has left the page.
            return
        if not outcome.done:
            outcome = Outcome(False, in_words(outcome.text))
        show_outcome(self._result, outcome, self._say)

    async def _update(self) -> None:
        load, change = self._lane.load()
        self._load.set_text(self._say.mass(load, 2))
        self._steady.set_value(_steadiness(change))
        self._moving.set_text(_in_motion(change, self._say))
        age = time.monotonic() - self._lane.judged
        self._last.set_text(_last_item(self._lane.last_estimate(), age, self._say))
        for step, tab, label in zip(self._steps, self._tabs, self._standings, strict=True):
            await step.update()
            standing = step.standing()
            tab.show(standing)
            show_told(label, standing.text, self._say)
        self._practice.update()
        self._show_buttons()

    def _show_buttons(self) -> None:
        step = self._steps[self._at]
        show_told(self._request, step.request(), self._say)
        others = step.others()
        self._primary.show(step.primary())
        self._next.show(self._next_step())
        for k, button in enumerate(self._others):
            button.show(others[k] if k < len(others) else None)

    def _next_step(self) -> Choice | None:
        """Return the button that leads to the next step, or None at the last step."""
        if self._at + 1 == len(STEPS):
            return None
        label = Text('Next: {step}', step=STEPS[self._at + 1].title)
        return Choice(label, self._go_on, self._steps[self._at].standing().is_done)

    async def _go_on(self) -> None:
        self._go(self._at + 1)


class _Tab:
    """Entry of the step list, with a tick if the step is done, and a text on its state."""

    def __init__(
        self, number: int, kind: type[Step], choose: Callable[[], object], say: Language
    ) -> None:
        self._say, self._name = say, f'{number + 1} {say(kind.title)}'
        self._button = ui.button(on_click=choose).props('flat no-caps').classes('tab')
        with self._button:
            self._title = ui.label(self._name).classes('name')
            self._text = ui.label('').classes('about')

    def show(self, standing: Standing) -> None:
        self._title.set_text(f'{self._name} {"✓" if standing.is_done else ""}'.rstrip())
        show_told(self._text, standing.text, self._say)

    def mark(self, *, is_current: bool) -> None:
        self._button.props(f'aria-current={"step" if is_current else "false"}')


class _Button:
    """Button at a fixed place, with the label and the function of the present `Choice`.

    The button is hidden while there is no choice for its place.
    """

    def __init__(
        self,
        look: str,
        clear: Callable[[], object],
        tell: Callable[[Outcome], object],
        say: Language,
    ) -> None:
        self._clear, self._tell, self._say = clear, tell, say
        self._choice: Choice | None = None
        self._is_working = False
        self._button = ui.button(on_click=self._press).props(f'{look} no-caps')

    def show(self, choice: Choice | None) -> None:
        before, self._choice = self._choice, choice
        self._button.set_visibility(choice is not None)
        if choice is not None:
            self._button.set_text(self._say(choice.label))
            is_new = before is None or choice.label != before.label
            self._button.set_enabled(choice.is_open and not is_new and not self._is_working)

    async def _press(self) -> None:
        choice = self._choice
        if choice is None or self._is_working:
            return
        self._is_working = True
        self._button.disable()
        self._clear()
        try:
            await choice.press()
        except ActionRefusedError as error:
            self._tell(Outcome(False, error.text))
        finally:
            self._is_working = False


def _steadiness(change: float) -> float:
    """Return the length of the stability bar for a change of the load in kg within 1 s.

    The length is 1 for a load at rest. The length is 0 if the change is NaN, or if it is at least
    `_MOVES` times `_AT_REST`.
    """
    if math.isnan(change):
        return 0.0
    return max(1.0 - math.log(max(change / _AT_REST, 1.0), _MOVES), 0.0)


def _last_item(last: MassEstimate | None, age: float, say: Language) -> str:
    if last is None or math.isinf(age):
        return ''
    return say(
        'last item: {mass}, {speed} m/min, {age} s ago',
        mass=say.mass(last.mass, 2),
        speed=say.number(MINUTE * last.belt_speed, 1),
        age=say.number(age, 0),
    )


def _in_motion(change: float, say: Language) -> str:
    if math.isnan(change):
        return say('no samples arrive: is the line running?')
    if change <= _AT_REST:
        return say('at rest')
    return say('moves by {mass}', mass=say.mass(change, 2))

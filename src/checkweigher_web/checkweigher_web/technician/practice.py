# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of a simulated machine, on which a technician causes faults and practises finding them."""

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
import math
from typing import Any

from nicegui import background_tasks, ui

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import LoadCell
from checkweigher_recording.simulation.operation import OperationParameters
from checkweigher_web.access.users import Role
from checkweigher_web.elements import named
from checkweigher_web.lane import Lane
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.shift import Shift
from checkweigher_web.views.view import View
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Desk, field, mass_in, number_in, show_outcome
from checkweigher_web.work.services import ActionRefusedError, Outcome

_MM, _PER_MINUTE = 1000.0, 60.0
_REASON = 'practice'  # reason in the audit log
_TEXT = Text(
    'These are the switches of a machine that is simulated. Commission it with them; then make a '
    'fault, and find it on this page. A change takes up to two seconds. It holds until it is taken '
    'back, or until the driver is started again. An empty field is as configured. The belt always '
    'runs: where a step asks to stop it, let no products come. Its width is not simulated: '
    'products for the test of eccentricity pass as always.'
)
# Largest displacement in mm of a photo-eye that its slider allows, in both directions.
_FARTHEST = 60
# Fields for numbers: parameter, label, unit, and factor from the parameter to the unit. The unit ''
# and the factor 0 stand for masses, which are in the unit of the user.
_NUMBERS = (
    ('speed', Text('Belt speed'), 'm/min', _PER_MINUTE),
    ('mass', Text('Mass of each product'), '', 0.0),
    ('gap', Text('Gap between products'), 'mm', _MM),
    ('load', Text('Mass that lies on the belt'), '', 0.0),
    ('zero', Text('The zero has drifted by'), '', 0.0),
)
_RATE = Text('items/min')
_EYES = {'infeed': Text('Infeed eye'), 'outfeed': Text('Outfeed eye')}


class Practice:
    """Settings of a simulated machine, which a technician can read and change."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk

    async def now(self) -> OperationParameters | None:
        """Return the settings of the machine, or None if it is not simulated or does not answer."""
        try:
            return await actions.operation(await self._desk.services())
        except ActionRefusedError:
            return None

    async def set(self, **values: object) -> Outcome:
        """Change settings of the machine, and return the outcome."""
        what = ', '.join(f'{name} {value}' for name, value in values.items())
        act = partial(actions.operate, await self._desk.services(), values)
        text = Text('simulated machine: {settings}', settings=what)
        return await self._desk.perform(Role.TECHNICIAN, text, act, _REASON)


class PracticeView(View):
    """View of a simulated machine from above, which is hidden for real machines.

    The view is also hidden if the viewer is not a technician.
    """

    title = Text('Practice: the simulated machine from above')
    columns = 2, 12
    recorded = False

    def _build(self) -> None:
        self._now = OperationParameters()
        self._cell: LoadCell | None = None
        with ui.element('div').classes('machine') as self._machine:
            ui.label(self.say(_TEXT)).classes('about')
            self._picture = ui.html('', sanitize=False)
            self._feed = ui.switch(self.say('Products come'), on_change=self._set_feed)
            self._rate = ui.label('')
            with ui.element('div').classes('form'):
                self._numbers = {each[0]: self._number(*each) for each in _NUMBERS}
            with ui.element('div').classes('form'):
                self._eyes = {name: _EyeControls(name, self._change, self.say) for name in _EYES}
            with ui.element('div').classes('in-a-row'):
                label = self.say('Mass of one product')
                self._put_mass = field(label, unit=self.say.unit).props('stack-label')
                for text, click in (
                    (self.say('Put it on the belt'), self._put),
                    (self.say('Kill the driver'), self._kill),
                    (self.say('All as configured'), self._restore),
                ):
                    ui.button(text, on_click=click).props('outline')
            self._result = ui.label('').props('role=status')
        self._machine.set_visibility(False)

    def _number(self, name: str, label: Text, unit: str, factor: float) -> ui.input:
        given = field(self.say(label), unit=unit or self.say.unit).props('debounce=800 stack-label')
        given.on_value_change(partial(self._set_number, name, factor or self.say.per_kg))
        return given

    def update(self) -> None:
        """Show the items per minute and, after each start of the driver, its settings.

        A start of the driver resets the settings.
        """
        if isinstance(self.lane, Lane):
            rate = self.lane.throughput() if self._now.feed else math.nan
            known = f'{self.say.number(rate, 0)} {self.say(_RATE)}'
            self._rate.set_text('' if math.isnan(rate) else known)
        # A new record of the load cell shows that the driver has started.
        if self.lane.load_cell is not self._cell:
            self._cell = self.lane.load_cell
            self._show()

    def _show(self) -> None:
        if self.look.practice is not None and is_simulated(self.lane):
            background_tasks.create(self._read())

    async def _read(self) -> None:
        assert self.look.practice is not None
        now = await self.look.practice.now()
        if self._machine.is_deleted:
            return
        self._machine.set_visibility(now is not None)
        if now is not None:
            self._show_settings(now, now.as_mapping())

    def _show_settings(self, now: OperationParameters, names: Collection[str]) -> None:
        """Store the settings `now`, and show the settings whose names are in `names`.

        Other fields are not changed, because the user may have typed in them in the meantime.
        """
        self._now = now
        for name, _, _, factor in _NUMBERS:
            if name in names:
                value = round((factor or self.say.per_kg) * getattr(now, name), 9)
                self._numbers[name].set_value(self.say.entry(value) if value else '')
        for name, eye in self._eyes.items():
            if any(each.startswith(name) for each in names):
                eye.show(now)
        if 'feed' in names:
            self._feed.set_value(now.feed)
        self._picture.set_content(picture(now, self.say))

    async def _set_number(self, name: str, factor: float) -> None:
        try:
            value = number_in(self._numbers[name], self.say, empty=0.0) / factor
        except ActionRefusedError as error:
            self._tell(Outcome(False, error.text))
            return
        await self._change(**{name: round(value, 9)})

    async def _set_feed(self) -> None:
        await self._change(feed=bool(self._feed.value))

    async def _put(self) -> None:
        try:
            mass = mass_in(self._put_mass, self.say, empty=0.0)
        except ActionRefusedError as error:
            self._tell(Outcome(False, error.text))
            return
        await self._change(put=self._now.put + 1, put_mass=mass)

    async def _kill(self) -> None:
        await self._change(kill=True)

    async def _restore(self) -> None:
        await self._change(**OperationParameters(put=self._now.put).as_mapping())

    async def _change(self, **values: Any) -> None:
        """Send values that differ from the present settings to the driver, and show the outcome.

        Nothing is sent if no value differs.
        """
        new = {name: value for name, value in values.items() if value != getattr(self._now, name)}
        if not new or self.look.practice is None:
            return
        try:
            replace(self._now, **new)
        except ParameterError as error:
            outcome = Outcome(False, str(error))
        else:
            outcome = await self.look.practice.set(**new)
        if outcome.done:  # `_now` may have changed in the meantime.
            self._show_settings(replace(self._now, **{**new, 'kill': False}), new)
        self._tell(outcome)

    def _tell(self, outcome: Outcome) -> None:
        show_outcome(self._result, outcome, self.say)


class _EyeControls:
    """Controls for the position, the lens and the cable of a photo-eye."""

    def __init__(self, name: str, change: Callable[..., Any], say: Language) -> None:
        eye = say(_EYES[name])
        self._name, self._change = name, change
        with ui.element('div').classes('eye'):
            ui.label(eye)
            self._place = ui.slider(min=-_FARTHEST, max=_FARTHEST, step=5, value=0)
            label = say('{eye}: place in mm', eye=eye)
            named(self._place.props('label'), label)
            self._place.on(
                'update:model-value', self._set_place, throttle=0.5, leading_events=False
            )
            with ui.element('div').classes('in-a-row'):
                self._dirty = ui.switch(say('dirty'), on_change=self._set_lens)
                self._dead = ui.switch(say('cable off'), on_change=self._set_lens)

    async def _set_place(self) -> None:
        await self._change(**{f'{self._name}_place': self._place.value / _MM})

    async def _set_lens(self) -> None:
        dirty, dead = bool(self._dirty.value), bool(self._dead.value)
        await self._change(**{f'{self._name}_dirty': dirty, f'{self._name}_dead': dead})

    def show(self, now: OperationParameters) -> None:
        """Show the settings of the eye."""
        self._place.set_value(round(_MM * getattr(now, f'{self._name}_place')))
        self._dirty.set_value(getattr(now, f'{self._name}_dirty'))
        self._dead.set_value(getattr(now, f'{self._name}_dead'))


def is_simulated(lane: Lane | Shift) -> bool:
    """Return whether the samples of a lane are simulated, or False if its load cell is unknown."""
    return lane.load_cell is not None and lane.load_cell.model == 'simulated'


# Sizes of the picture in px. From left to right, it shows the infeed, weigh and outfeed belts.
_WIDTH, _HEIGHT, _BEGIN, _END, _TOP, _BOTTOM = 480, 188, 170, 310, 74, 134
_PRODUCT, _USUAL_GAP, _WIDEST_GAP = 40, 60, 300
_SCALE = 1000.0  # px per m for gaps and displacements of eyes, which are drawn enlarged


def picture(now: OperationParameters, say: Language = ENGLISH) -> str:
    """Return a picture of the line from above as SVG: its products, the load, and its eyes."""
    parts = [
        _box(begin, _TOP, end - begin - 4, _BOTTOM - _TOP, kind)
        for begin, end, kind in (
            (0, _BEGIN, 'belt'),
            (_BEGIN, _END, 'belt weighs'),
            (_END, _WIDTH, 'belt'),
        )
    ]
    step = _PRODUCT + (min(_SCALE * now.gap, _WIDEST_GAP) if now.gap else _USUAL_GAP)
    place = _BEGIN - 25.0 - _PRODUCT
    while now.feed and place >= 0:
        parts.append(_box(place, _TOP + 12, _PRODUCT, _BOTTOM - _TOP - 24, 'product'))
        place -= step
    middle = (_BEGIN + _END) / 2
    if now.load:
        parts.append(f'<circle class="load" cx="{middle:g}" cy="{_TOP + 30}" r="10"/>')
    for y, holds, text in (
        (_BOTTOM + 24, now.load, say('{mass} on the belt', mass=say.short(now.load))),
        (_BOTTOM + 46, now.zero, say('zero off by {mass}', mass=say.short(now.zero))),
    ):
        if holds:
            parts.append(_text(middle, y, text))
    if not now.feed:
        parts.append(_text(_BEGIN / 2, (_TOP + _BOTTOM) / 2 + 6, say('no products come')))
    parts += [_eye(now, 'infeed', _BEGIN, 'end', say), _eye(now, 'outfeed', _END, 'start', say)]
    label = say('the line from above')
    return (
        f'<svg class="line" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="{label}">{"".join(parts)}</svg>'
    )


def _eye(now: OperationParameters, name: str, place: float, anchor: str, say: Language) -> str:
    """Return the beam of an eye as SVG, with its name and state as text."""
    dirty, dead = getattr(now, f'{name}_dirty'), getattr(now, f'{name}_dead')
    moved = getattr(now, f'{name}_place')
    x = place + _SCALE * moved
    kind = 'dead' if dead else 'dirty' if dirty else 'clean'
    told = say('cable off') if dead else say('dirty') if dirty else ''
    moved_by = f'{_MM * moved:+g} mm' if moved else ''
    state = ', '.join(filter(None, (told, moved_by)))
    at = place + (25 if anchor == 'end' else -25)
    return (
        f'<line class="beam {kind}" x1="{x:g}" y1="{_TOP - 16}" x2="{x:g}" y2="{_BOTTOM + 8}"/>'
        f'<circle class="lens {kind}" cx="{x:g}" cy="{_TOP - 20}" r="7"/>'
        + _text(at, 17, say(_EYES[name]), anchor)
        + _text(at, 38, state, anchor)
    )


def _box(x: float, y: float, width: float, height: float, kind: str) -> str:
    return f'<rect class="{kind}" x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"/>'


def _text(x: float, y: float, text: str, anchor: str = 'middle') -> str:
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}">{text}</text>'

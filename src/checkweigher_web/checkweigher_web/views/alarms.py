# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the alarms of a lane, with the signal of a fault."""

from collections.abc import Sequence
import time

from nicegui import ui

from checkweigher_core.records import NANOSECONDS, Alarm
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import Cell, Figure, Lines, Table, told
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.languages.wording import from_node
from checkweigher_web.views.signal import Signal, item_text, signal_of, signal_texts
from checkweigher_web.views.view import View

_FAULT = 'fault'  # `source` of an alarm that was raised because an item is a fault
_HEADS = (
    Text('order'),
    Text('alarm'),
    Text('first'),
    Text('last'),
    Text('times'),
    Text('state'),
    Text('what to check'),
)
# Text on an item, its figure as JSON, and the texts of its marks.
Picture = tuple[str, str, tuple[str, ...]]


class AlarmsView(View):
    """Unacknowledged alarms in the order of their beginning, then acknowledged, then ended alarms.

    The first alarm is often the cause of the other alarms. Below the alarms, the view shows the
    signal of an item with the reason of the first fault alarm.
    """

    title = Text('Alarms')
    columns = 1, 7
    recorded = False

    def _build(self) -> None:
        with ui.element('div').classes('in-a-row'):
            self._headline = ui.label('').classes('about')
            if 'Acknowledge alarms' in self.look.work:
                acknowledge = self.look.work['Acknowledge alarms']
                text = self.say('Acknowledge alarms')
                ui.button(text, on_click=acknowledge).props('outline')
        self._rows = Table(map(self.say, _HEADS))
        with ui.element('div') as self._picture:
            self._about = ui.label('').classes('about')
            self._figure = Figure(self.say('signal of the first alarm'), self.say)
            self._marks = Lines().classes('marks')

    def _state(self) -> object:
        lasts = any(each.active for each in self.lane.alarms)
        return self.lane.alarms, self.lane.over, int(time.monotonic()) if lasts else 0, self._shot()

    def _show(self) -> None:
        alarms, over = in_order(self.lane.alarms), self.lane.over
        waiting = sum(not each.acknowledged_by for each in alarms)
        self._headline.set_text(
            self.say(
                '{waiting} not acknowledged, {over} over since the page runs',
                waiting=waiting,
                over=len(over),
            )
        )
        now = time.time_ns()
        self._rows.show([*rows(alarms, now, self.say), *rows(over[::-1], 0, self.say)])
        picture = self._shot()
        self._picture.set_visibility(picture is not None)
        if picture is not None:
            about, figure, marks = picture
            self._about.set_text(about)
            self._figure.show_text(figure)
            self._marks.show(marks)

    def _shot(self) -> Picture | None:
        name = 'shot', self.say
        return self.drawing.each_second(name, lambda: picture_of(self.drawing, self.say))


def in_order(alarms: Sequence[Alarm]) -> list[Alarm]:
    """Return unacknowledged alarms, then acknowledged alarms, each in order of their beginning."""
    return sorted(alarms, key=lambda each: (bool(each.acknowledged_by), each.first))


def rows(alarms: Sequence[Alarm], now: int, say: Language = ENGLISH) -> list[tuple[Cell, ...]]:
    """Return a row for each alarm at time `now` in ns. `now` is 0 if all have ended."""
    return [
        (
            say(_order(place, each, now)),
            f'{say(each.source)} {each.reason}',
            say.clock(each.first),
            say.clock(each.last),
            str(each.count),
            state_of(each, now, say),
            told(from_node(each.text), say),
        )
        for place, each in enumerate(alarms)
    ]


def _order(place: int, alarm: Alarm, now: int) -> str:
    if not now:
        return Text('over')
    return Text('first') if place == 0 and not alarm.acknowledged_by else ''


def state_of(alarm: Alarm, now: int = 0, say: Language = ENGLISH) -> str:
    """Return a text on the duration and the acknowledgement of an alarm at time `now` in ns.

    `now` is 0 if the alarm has ended and is therefore no longer in the list of the lane.
    """
    lasted = alarm.duration
    if alarm.active and now:
        lasted += max(now - alarm.last, 0) / NANOSECONDS
    parts = [say('lasts')] if alarm.active and now else []
    parts += [f'{lasted:.0f} s'] if lasted else []
    if alarm.acknowledged_by:
        parts.append(say('acknowledged by {name}', name=alarm.acknowledged_by))
    else:
        parts.append(say('not acknowledged') if now else say('over'))
    return ', '.join(parts)


def picture_of(drawing: Drawing, say: Language = ENGLISH) -> Picture | None:
    """Return the picture of the latest item that has the reason of the first fault alarm.

    Returns None if there is no fault alarm, no item with its reason, or no raw signal of this item.
    The signal is cached, because the lane soon drops its samples.
    """
    pictures: dict[tuple[str, int], Signal] = drawing.once('pictures', None, dict)
    alarms = [each for each in in_order(drawing.lane.alarms) if each.source == _FAULT]
    if not alarms:
        return None
    key = alarms[0].reason, alarms[0].first
    if key not in pictures:
        faults = drawing.items(only_faults=True)
        item = next((each for each in faults if key[0] in each.verdict.reasons), None)
        if item is None or drawing.lane.with_signals(item).stretch is None:
            return None
        pictures.clear()
        pictures[key] = signal_of(drawing, item)
    signal, cell = pictures[key], drawing.lane.load_cell

    def draw() -> Picture:
        return item_text(signal[0], say), *signal_texts(*signal, cell, say)

    return drawing.once(('picture', say), key, draw)

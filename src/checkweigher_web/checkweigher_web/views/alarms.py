# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the alarms of a lane, with the signal of a fault."""

from collections.abc import Sequence
import time

from nicegui import ui

from checkweigher_core.records import NANOSECONDS, Alarm
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import Figure, Lines, Table
from checkweigher_web.views.signal import drawn
from checkweigher_web.views.view import View
from checkweigher_web.words import clock, said, when

_FAULT = 'fault'  # source of alarms that items raise
_HEADS = 'order', 'alarm', 'first', 'last', 'times', 'state', 'what to check'
Picture = tuple[str, str, tuple[str, ...]]  # text on an item, its figure as JSON, and its marks


class AlarmsView(View):
    """Alarms in the order in which they came, the acknowledged ones and those that are over last.

    The first alarm is often the cause of the others. Below the alarms is the signal of an item with
    the first fault.
    """

    title = 'Alarms'
    columns = 1, 7
    recorded = False

    def _build(self) -> None:
        with ui.element('div').classes('in-a-row'):
            self._headline = ui.label('').classes('about')
            if 'Acknowledge alarms' in self.look.work:
                acknowledge = self.look.work['Acknowledge alarms']
                ui.button('Acknowledge alarms', on_click=acknowledge).props('outline')
        self._rows = Table(_HEADS)
        with ui.element('div') as self._picture:
            self._about = ui.label('').classes('about')
            self._figure = Figure('signal of the first alarm')
            self._marks = Lines().classes('marks')

    def _state(self) -> object:
        lasts = any(each.active for each in self.lane.alarms)
        return self.lane.alarms, self.lane.over, int(time.monotonic()) if lasts else 0, self._shot()

    def _show(self) -> None:
        alarms, over = in_order(self.lane.alarms), self.lane.over
        waiting = sum(not each.acknowledged_by for each in alarms)
        self._headline.set_text(f'{waiting} not acknowledged, {len(over)} over since the page runs')
        self._rows.show([*rows(alarms, time.time_ns()), *rows(over[::-1], 0)])
        picture = self._shot()
        self._picture.set_visibility(picture is not None)
        if picture is not None:
            about, figure, marks = picture
            self._about.set_text(about)
            self._figure.show_text(figure)
            self._marks.show(marks)

    def _shot(self) -> Picture | None:
        return self.drawing.each_second('picture', lambda: picture_of(self.drawing))


def in_order(alarms: Sequence[Alarm]) -> list[Alarm]:
    """Return alarms in the order in which they came, the acknowledged ones last."""
    return sorted(alarms, key=lambda each: (bool(each.acknowledged_by), each.first))


def rows(alarms: Sequence[Alarm], now: int) -> list[tuple[str, ...]]:
    """Return a row for each alarm at time `now` in ns, which is 0 for alarms that are over."""
    return [
        (
            'over' if not now else 'first' if place == 0 and not each.acknowledged_by else '',
            f'{each.source} {each.reason}',
            clock(each.first),
            clock(each.last),
            str(each.count),
            state_of(each, now),
            each.text,
        )
        for place, each in enumerate(alarms)
    ]


def state_of(alarm: Alarm, now: int = 0) -> str:
    """Return a text on the duration and the acknowledgement of an alarm at time `now` in ns."""
    lasted = alarm.duration
    if alarm.active and now:
        lasted += max(now - alarm.last, 0) / NANOSECONDS
    parts = ['lasts'] if alarm.active and now else []
    parts += [f'{lasted:.0f} s'] if lasted else []
    acknowledged = f'acknowledged by {alarm.acknowledged_by}' if alarm.acknowledged_by else ''
    return ', '.join([*parts, acknowledged or ('not acknowledged' if now else 'over')])


def picture_of(drawing: Drawing) -> Picture | None:
    """Return the signal of an item with the first fault in the alarms, or None without a signal.

    The signal is cached, because the lane soon drops its samples.
    """
    pictures: dict[tuple[str, int], Picture] = drawing.once('pictures', None, dict)
    alarms = [each for each in in_order(drawing.lane.alarms) if each.source == _FAULT]
    if not alarms:
        return None
    key = alarms[0].reason, alarms[0].first
    if key not in pictures:
        faults = drawing.items(only_faults=True)
        item = next((each for each in faults if key[0] in each.verdict.reasons), None)
        if item is None or drawing.lane.with_signals(item).stretch is None:
            return None
        about = f'item {item.verdict.item_id} at {when(item.verdict)}: {said(item.verdict)}'
        pictures.clear()
        pictures[key] = about, *drawn(drawing, item)
    return pictures[key]

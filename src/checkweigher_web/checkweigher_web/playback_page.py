# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a recorded shift, with the views of a lane and a slider to choose an item."""

from functools import partial

from nicegui import ui

from checkweigher_core.printable import counted
from checkweigher_core.records import NANOSECONDS
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import panel
from checkweigher_web.page import show_lane
from checkweigher_web.shift import Playback, Shift
from checkweigher_web.views.view import Look
from checkweigher_web.words import when

_PERIOD = 0.5  # period of the updates of the progress in s


class PlaybackPage:
    """The views of a shift for one browser, with a slider to choose an item.

    `report` is the address of an accuracy report, or '' if there is none.
    """

    def __init__(self, shift: Shift, name: str, report: str = '') -> None:
        self._shift = shift
        self._playback = Playback(shift, name)
        with panel('Recording').classes('playback'):
            with ui.element('div').classes('in-a-row'):
                ui.label(name).classes('name')
                self._progress = ui.label('').props('role=status')
                if report:
                    ui.link('accuracy report', report)
            # The slider of the browser can be used with the keyboard and with screen readers.
            self._slider = (
                ui.element('input')
                .classes('slider')
                .props('type=range min=1 max=1 step=1 value=1 aria-label="item of the shift"')
            )
            emit = 'event => emit(Number(event.target.value))'
            self._slider.on('input', lambda event: self._go(event.args - 1), js_handler=emit)
            with ui.element('div').classes('in-a-row'):
                for text, move in (
                    ('previous item', lambda: self._go(self._playback.place - 1)),
                    ('next item', lambda: self._go(self._playback.place + 1)),
                    ('previous fault', partial(self._go_to_fault, False)),
                    ('next fault', partial(self._go_to_fault, True)),
                ):
                    ui.button(text, on_click=move).props('outline no-caps dense padding="xs sm"')
                self._where = ui.label('').classes('where')
        self._look = Look(Drawing(self._playback))
        show_lane(self._look)
        self._timer = ui.timer(_PERIOD, self._follow)
        self._follow()

    def _follow(self) -> None:
        shift, count = self._shift, len(self._shift.items)
        whole = shift.is_whole
        self._slider.props['max'] = max(count, 1)
        length = (shift.end - shift.begin) / NANOSECONDS
        faults = counted(len(shift.faults), 'fault')
        text = f'{counted(count, "item")}, {faults} in {length / 60:.1f} min'
        self._progress.set_text(text if whole else f'weighing: {shift.progress:.0%}, {text}')
        self._show_place()
        if whole:
            self._timer.deactivate()

    def _go(self, place: int) -> None:
        self._playback.go(place)
        self._look.choose('')
        self._show_place()

    def _go_to_fault(self, forward: bool) -> None:
        place = self._playback.next_fault(forward=forward)
        if place is None:
            ui.notify(f'no fault {"after" if forward else "before"} this item')
        else:
            self._go(place)

    def _show_place(self) -> None:
        self._slider.props['value'] = self._playback.place + 1
        place, items = self._playback.place, self._shift.items
        if place < len(items):
            self._where.set_text(f'item {place + 1} of {len(items)}, {when(items[place].verdict)}')

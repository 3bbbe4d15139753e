# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Page of a lane or of a recorded shift, with views that are kept up to date."""

from functools import partial

from nicegui import ui
from nicegui.element import Element

from checkweigher_core.records import NANOSECONDS
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import STYLE, panel
from checkweigher_web.languages.language import Language
from checkweigher_web.shift import Shift
from checkweigher_web.views.registry import VIEWS
from checkweigher_web.views.view import FAST, SLOW, Look, View

_WHOLE = '--tablet: 2; --desk: 12'  # width in columns of a panel as wide as the page
_PERIOD = 0.5  # time in s between two updates of the progress text


def show_lane(look: Look) -> Element:
    """Show the views of a lane or shift to a viewer, keep them current, and return their container.

    A recorded shift, for which `look.board` is None, has other views than a running lane.
    """
    ui.add_css(STYLE)
    live = look.board is not None
    with ui.element('div').classes('board') as board:
        views = [
            _build(name, kind, look)
            for name, kind in VIEWS.items()
            if (kind.live if live else kind.recorded)
        ]
    for period in (FAST, SLOW):
        due = [view for view in views if view.period == period]
        ui.timer(period if live else FAST, partial(_update, due))
    return board


def show_shift(shift: Shift, drawing: Drawing, say: Language, report: str = '') -> None:
    """Show a recorded shift to one viewer. `report` is the address of an accuracy report, or ''."""
    board = show_lane(Look(drawing, say=say))
    with board, panel(say('Recording'), 'recording').style(_WHOLE) as about:
        ui.label(shift.name).classes('name')
        progress = ui.label('').props('role=status')
        if report:
            ui.link(say('accuracy report'), report)
    about.move(target_index=0)

    def update() -> None:
        text = say(
            '{items}, {faults} in {time}',
            items=say.plural('{count} item', '{count} items', shift.version),
            faults=say.plural('{count} fault', '{count} faults', len(shift.faults())),
            time=say.number((shift.end - shift.begin) / 60 / NANOSECONDS, 1, ' min'),
        )
        whole, percent = shift.is_whole, round(100 * shift.progress)
        weighing = say('weighing: {percent} %, {items}', percent=percent, items=text)
        progress.set_text(text if whole else weighing)
        if whole:
            timer.deactivate()

    timer = ui.timer(_PERIOD, update)


def _build(name: str, kind: type[View], look: Look) -> View:
    tablet, desk = kind.columns
    with panel(look.say(kind.title), name).style(f'--tablet: {tablet}; --desk: {desk}'):
        return kind(look)


def _update(views: list[View]) -> None:
    for view in views:
        view.update()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Page of all lanes, with a row for each lane and a link to the page of the lane."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
import time

from nicegui import ui

from checkweigher_core.health.findings import Level
from checkweigher_core.ros.status_board import LaneRow, by_lane
from checkweigher_web.drawing import Made
from checkweigher_web.elements import STYLE, Cell, Table, Told, level_cell, panel, told
from checkweigher_web.lane import Lane
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.languages.wording import from_node
from checkweigher_web.listening import Watch

_PERIOD = 1.0  # s
_HEADS = (
    Text('state'),
    Text('lane'),
    Text('host'),
    Text('product'),
    Text('items/min'),
    Text('accepted'),
    Text('rejected'),
    Text('faults'),
    Text('the worst, and what to check'),
)


@dataclass(frozen=True, slots=True)
class LaneView:
    """Row of the page of all lanes: namespace and level of a lane, and table cells."""

    name: str
    level: Level
    cells: tuple[Cell, ...]


class Overview(Made):
    """Rows of all lanes, computed at most once per second for all viewers of a language."""

    def __init__(self, watch: Watch) -> None:
        super().__init__()
        self._watch = watch

    def views(self, say: Language = ENGLISH) -> list[LaneView]:
        """Return a row for each lane that runs or has run, or that has sent diagnostics.

        If the page shows only one lane, the other lanes are left out. Lanes without diagnostics
        come first, followed by the other lanes, the worst lane first.
        """
        return self.each_second(('views', say), lambda: self._views(say))

    def only(self) -> str | None:
        """Return the namespace of the lane if there is exactly one, otherwise None.

        Also returns None if the page has received only diagnostics of this lane.
        """
        names = [_name(row) for row in self._rows()]
        return names[0] if len(names) == 1 and names[0] in self._watch.lanes else None

    def _views(self, say: Language) -> list[LaneView]:
        lanes, hosts = self._watch.lanes, self._watch.board.hosts()
        return [_view(row, lanes.get(_name(row)), hosts, say) for row in self._rows()]

    def _rows(self) -> list[LaneRow]:
        return self.each_second('rows', self._made_rows)

    def _made_rows(self) -> list[LaneRow]:
        lanes, board = dict(self._watch.lanes), self._watch.board
        known = by_lane(board.rows(time.monotonic())) if board.heard else []
        silent = lanes.keys() - {_name(row) for row in known}
        text = 'no diagnostics have come; see whether its nodes run'
        rows = [LaneRow(name, Level.STALE, (), text) for name in sorted(silent)] + known
        return [row for row in rows if self._watch.only in (None, _name(row))]


def _name(row: LaneRow) -> str:
    return row.lane.strip('/')


def _view(row: LaneRow, lane: Lane | None, hosts: dict[str, set[str]], say: Language) -> LaneView:
    name = _name(row)
    known = None if lane is None else lane.statistics
    product, throughput = ('', math.nan) if known is None else (known.product, known.throughput)
    host = ', '.join(sorted(hosts.get(name, ())))
    link = name or say('(no namespace)'), f'/lane/{name}'
    texts = (each or '–' for each in (host, product, say.number(throughput, 1)))
    counts = map(str, row.counts)
    cells: tuple[Cell, ...] = (level_cell(row.level, say), link, *texts, *counts, _worst(row, say))
    return LaneView(name, row.level, cells)


def _worst(row: LaneRow, say: Language) -> Told:
    """Return the worst finding of a lane as a cell, without a translation of node and aspect."""
    *place, message = row.worst.split(': ', 1)
    cell = told(from_node(message) if row.worst else Text('all is well'), say)
    return cell._replace(text=': '.join((*place, cell.text)))


def show_overview(lanes: Overview, say: Language) -> None:
    """Show a row for each lane, and keep the rows up to date.

    If there is exactly one lane, the browser reloads the page, which then shows this lane.
    """
    ui.add_css(STYLE)
    with ui.element('div').classes('lanes'), panel(say('Lanes')):
        headline = ui.label('').classes('about')
        table = Table(map(say, _HEADS))

    def update() -> None:
        if lanes.only() is not None:
            ui.navigate.reload()  # The reloaded page shows the only lane.
        shown = lanes.views(say)
        headline.set_text(_headline(shown, say))
        table.show(view.cells for view in shown)

    ui.timer(_PERIOD, update)


def wait_for_lane(name: str, runs: Callable[[], bool], say: Language) -> None:
    """Show that a lane does not run, and load its page as soon as `runs` returns true."""
    ui.add_css(STYLE)
    with ui.element('div').classes('lanes'), panel(say('Lane')):
        text = Text('no lane {name} runs here; this page shows it as soon as it does')
        ui.label(say(text, name=repr(name)))
    ui.timer(_PERIOD, lambda: ui.navigate.reload() if runs() else None)


def _headline(shown: Sequence[LaneView], say: Language) -> str:
    if not shown:
        return say('no lane runs yet; is the line running, and in this ROS_DOMAIN_ID?')
    well = sum(view.level is Level.OK for view in shown)
    return say.plural(
        '{count} lane, {well} of them well',
        '{count} lanes, {well} of them well',
        len(shown),
        well=well,
    )

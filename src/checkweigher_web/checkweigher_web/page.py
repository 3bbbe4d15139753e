# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a lane: views that follow what the lane shows."""

from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
import time

from nicegui import ui

from checkweigher_core.health.findings import Level
from checkweigher_core.records import Statistics
from checkweigher_core.ros.status_board import Row, StatusBoard, headline
from checkweigher_web import charts
from checkweigher_web.drawing import EMPTY, Drawing, row_key
from checkweigher_web.elements import Figure, ItemList, Table, panel
from checkweigher_web.lane import Item
from checkweigher_web.standstill import standstill
from checkweigher_web.words import about, batch_rules, clock, decided, grams, hint, production, said

_PERIOD = 0.1  # s; what comes in between is shown at once
_SLOW_PERIOD = 1.0  # s, of what nobody reads faster
_HEADS = 'item', 'time', 'gross, g', '± g', 'reference g', 'verdict'
_REASON_HEADS = 'items', 'reason', 'what to check'
_STATUS_HEADS = 'level', 'node', 'what is, and what to check'
STYLE = Path(__file__).with_name('page.css').read_text(encoding='utf-8')


class LanePage:
    """The views of one lane for one browser.

    Each period they show the present state of the lane: a slow browser skips items, it never holds
    anything up. Mass, verdict, signal and list come first, the figures over many items follow. With
    `keep` the item whose signal is shown can be kept.

    A further view is a `panel` here with a place in the grid of page.css; what it shows is made
    once for all viewers in `Drawing`.
    """

    def __init__(
        self, drawing: Drawing, board: StatusBoard | None = None,
        keep: Callable[[Item], Awaitable[None]] | None = None,
    ) -> None:  # fmt: skip
        self._drawing = drawing
        self._lane = drawing.lane
        self._board = board
        self._keep = keep
        self._version: object = None  # of the lane in what is shown
        self._analysed: object = None  # the same, of what is shown once a second
        self._chosen = ''  # key of the item that the viewer has chosen; '' for the latest
        self._signalled: Item | None = None  # the one whose signal is shown
        self._standstill = ''  # why the lane does not weigh
        self._marked: tuple[str, ...] = ()
        ui.add_css(STYLE)
        ui.colors(primary=charts.DENOISED)
        with ui.element('main').classes('board'):
            self._show_panels()
        ui.timer(_PERIOD, self._update)
        # A recorded shift changes by the hand of its viewer alone, who waits for all of it.
        ui.timer(_PERIOD if board is None else _SLOW_PERIOD, self._update_slowly)

    def _show_panels(self) -> None:
        with panel('Item', 'item'):
            self._still = ui.label('').classes('level-ERROR').props('role=status')
            self._decision = ui.label('no item yet').classes('decision NONE')
            self._mass = ui.label('–').classes('mass')
            self._about = ui.label('').classes('about')
            self._why = ui.label('').classes('level-ERROR')
            self._stop = ui.label('').classes('stop level-ERROR').props('role=alert')
        with panel('Signal', 'signal'):
            self._about_signal = ui.label('').classes('about')
            self._signal = Figure('signal of the item')
            self._why_signal = ui.label('').classes('level-ERROR')
            self._marks = ui.element('ol').classes('marks')
            with ui.element('div').classes('in-a-row'):
                # Of a recorded shift that is the one at which its slider stands.
                latest = 'show this item' if self._board is None else 'show the latest item'
                self._latest = ui.button(latest, on_click=self.show_latest)
                self._latest.props('outline no-caps dense padding="xs sm"')
                if self._keep is not None:
                    keep = ui.button('keep this item', on_click=self._keep_shown)
                    keep.props('outline no-caps dense padding="xs sm"')
        with panel('Items', 'list'):
            self._only_faults = ui.checkbox('faults only', on_change=self._again)
            with ui.element('div').classes('items').props('tabindex=0 aria-label="list of items"'):
                self._list = ItemList(_HEADS, self._choose)
        with panel('Faults' if self._board is None else 'Diagnostics', 'health'):
            self._headline = ui.label('').classes('about')
            self._diagnostics = Table(_REASON_HEADS if self._board is None else _STATUS_HEADS)
        with panel('Production', 'production'):
            self._production = Table(('what', 'value'))
            self._rules = Table(('rule for the batch', 'how it stands'))
        with panel('Masses of the accepted items', 'masses'):
            self._masses = Figure('histogram of the masses')
        with panel('Control chart: means', 'means'):
            self._means = Figure('control chart of the means')
        with panel('Control chart: standard deviations', 'spreads'):
            self._spreads = Figure('control chart of the standard deviations')
        with panel('Zero', 'zero'):
            self._zero = Figure('zero of the empty belt')
        with panel('Empty belt', 'belt'):
            self._spectrum = Figure('spectrum of the empty belt')
            self._lines = Table(('Hz', 'g', 'what it might be'))
        for figure in (self._signal, self._masses, self._means, self._spreads, self._zero,
                       self._spectrum):  # fmt: skip
            figure.show(EMPTY)

    def _update(self) -> None:
        if self._version == self._lane.version:
            return
        self._version = self._lane.version
        items, only_faults = self._drawing.items(), bool(self._only_faults.value)
        if items:
            self._show_item(items[0])
        stop = self._lane.stop
        self._stop.set_text('' if stop is None else f'STOP {stop.reason}: {stop.hint}')
        self._list.show(self._drawing.rows(only_faults=only_faults))
        self._list.choose(self._chosen)
        listed = self._drawing.items(only_faults=only_faults)
        chosen = (item for item in listed if self._chosen in ('', row_key(item.key)))
        self._show_signal(next(chosen, None))

    def _show_item(self, item: Item) -> None:
        verdict = item.verdict
        self._decision.set_text(decided(verdict))
        # What looks like news from two metres has to be some.
        still = bool(self._standstill)
        self._decision.classes(replace=f'decision {"NONE" if still else verdict.decision.name}')
        self._mass.set_text(grams(verdict.mass, ' g', digits=2))
        self._mass.classes(replace='mass still' if still else 'mass')
        self._about.set_text(about(item))
        self._why.set_text(_why(item))

    def _show_signal(self, item: Item | None) -> None:
        self._latest.set_visibility(bool(self._chosen))
        if item is None:  # so old that it is not known any more
            return
        self._signalled = item
        verdict, signal = item.verdict, self._drawing.signal(item)
        self._about_signal.set_text(f'item {verdict.item_id} at {_when(item)}: {said(verdict)}')
        self._why_signal.set_text(_why(item))
        self._signal.show(signal.figure)
        if signal.marks != self._marked:
            self._marked = signal.marks
            self._marks.clear()
            for mark in signal.marks:
                with self._marks, ui.element('li'):
                    ui.label(mark)

    async def _keep_shown(self) -> None:
        if self._keep is not None and self._signalled is not None:
            await self._keep(self._signalled)

    def show_latest(self) -> None:
        """Show the signal of the latest item instead of that of a chosen one."""
        self._choose('')

    def _choose(self, key: str) -> None:
        self._chosen = key
        self._again()

    def _again(self) -> None:
        """Show everything at the next update."""
        self._version = None

    def _update_slowly(self) -> None:
        if self._board is not None:
            rows = [
                row
                for row in self._board.rows(time.monotonic())
                if row.node.strip('/').rpartition('/')[0] == self._lane.name
            ]
            self._show_standstill(standstill(rows))
            self._show_diagnostics(rows)
            self._show_belt()
        if self._analysed == self._lane.version:
            return
        self._analysed = self._lane.version
        statistics = self._lane.statistics
        self._production.show(production(statistics, self._lane.filler))
        items = self._drawing.items()
        self._rules.show(batch_rules(statistics, items[0].verdict if items else None))
        if self._board is None:
            self._show_reasons(statistics)
            self._show_belt()
        overview = self._drawing.overview()
        self._masses.show(overview.masses)
        self._means.show(overview.means)
        self._spreads.show(overview.spreads)
        self._zero.show(overview.zero)

    def _show_reasons(self, statistics: Statistics | None) -> None:
        """Show why items were faults, the most frequent reason first."""
        counts = Counter[str]()
        if statistics is not None:
            counts.update(dict(zip(statistics.reasons, statistics.reason_counts, strict=True)))
        self._headline.set_text('' if counts else 'no fault until now')
        frequent = counts.most_common()
        self._diagnostics.show((str(count), reason, hint(reason)) for reason, count in frequent)

    def _show_standstill(self, why: str) -> None:
        """Show why the lane does not weigh, and its latest item as what has been."""
        if bool(why) != bool(self._standstill):
            self._again()
        self._standstill = why
        items = self._drawing.items() if why else []
        last = f', last item at {_when(items[0])}' if items else ''
        self._still.set_text(why + last)

    def _show_diagnostics(self, rows: Sequence[Row]) -> None:
        self._headline.set_text(headline(rows))
        shown = [row for row in rows if row.level != Level.OK]
        self._diagnostics.show(
            (row.level.name, f'{row.node} {row.aspect}', row.message) for row in shown
        )

    def _show_belt(self) -> None:
        belt = self._drawing.belt()
        if belt is not None:
            self._spectrum.show(belt.figure)
            self._lines.show(
                (f'{each.frequency:.1f}', grams(each.amplitude), each.guess) for each in belt.lines
            )


def _when(item: Item) -> str:
    """Return when an item was weighed."""
    return clock(item.verdict.t3 or item.verdict.t1)


def _why(item: Item) -> str:
    """Return the reasons of an item, each with what to check."""
    return '; '.join(f'{each}: {hint(each)}' for each in item.verdict.reasons)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a lane: views that follow what the lane shows."""

from collections.abc import Awaitable, Callable, Iterable, Mapping
from datetime import UTC, datetime
import math
from pathlib import Path
import time

from nicegui import ui
from nicegui.element import Element

from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.health.status_board import StatusBoard, headline
from checkweigher_dsp.production.control_chart import control_chart
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import GRAMS, NANOSECONDS, Statistics, Verdict
from checkweigher_web import charts
from checkweigher_web.empty_belt import spectrum
from checkweigher_web.fault_marks import Mark, fault_marks
from checkweigher_web.lane import Item, Key, Lane
from checkweigher_web.shift import Playback

_PERIOD = 0.1  # s; what comes in between is shown at once
_SLOW_PERIOD = 1.0  # s, of what nobody reads faster
_SHOWN = 100  # items in the list
_HEADS = 'item', 'time', 'mass g', '± g', 'reference g', 'verdict'
_REASON_HEADS = 'items', 'reason', 'what to check'
_STATUS_HEADS = 'level', 'node', 'what is, and what to check'
_STYLE = Path(__file__).with_name('page.css').read_text(encoding='utf-8')
# Colour is never the only sign.
_SIGNS = {'ACCEPT': '✓', 'UNDER': '↓', 'OVER': '↑', 'FAULT': '✗'}


class LanePage:
    """The views of one lane for one browser.

    Each period they show the present state of the lane: a slow browser skips items, it never holds
    anything up. With `keep` the item whose signal is shown can be kept.
    """

    def __init__(
        self, lane: Lane | Playback, board: StatusBoard | None = None,
        keep: Callable[[Item], Awaitable[None]] | None = None,
    ) -> None:  # fmt: skip
        self._lane = lane
        self._board = board
        self._keep = keep
        self._version: object = None
        self._kept: Key | None = None  # the item that the viewer has chosen; None for the latest
        self._item: Item | None = None  # the latest
        self._signalled: Item | None = None  # the one whose signal is shown
        self._analysed: object = None  # version of the lane in what is shown once a second
        self._counted: Key | None = None  # the latest item in the figures over items
        self._rows: dict[Key, tuple[Element, Item]] = {}
        self._drawn: tuple[Key, bool, int, int | None] | None = None
        ui.add_css(_STYLE)
        ui.colors(primary=charts.DENOISED)
        with ui.element('main').classes('board'):
            with panel('Item'):
                self._decision = ui.label('no item yet').classes('decision NONE')
                self._mass = ui.label('–').classes('mass')
                self._about = ui.label('')
                self._why = ui.label('').classes('level-ERROR')
                self._stop = ui.label('').classes('level-ERROR').props('role=alert')
            with panel('Signal'):
                self._about_signal = ui.label('')
                self._signal = _chart('signal of the item')
                self._marks = ui.element('ol').classes('marks')
                self._latest = ui.button('show the latest item', on_click=self._show_latest)
                if keep is not None:
                    ui.button('keep this item', on_click=self._keep_shown)
            with panel('Items'):
                self._only_faults = ui.checkbox('faults only', on_change=self._again)
                with ui.element('div').classes('items'):
                    self._list = _table_of(_HEADS)
            with panel('Production'):
                self._production = Table(('what', 'value'))
            with panel('Faults' if board is None else 'Diagnostics'):
                self._headline = ui.label('')
                heads = _REASON_HEADS if board is None else _STATUS_HEADS
                self._diagnostics = Table(heads)
            with panel('Masses of the accepted items'):
                self._histogram = _chart('histogram of the masses')
            with panel('Control chart: means'):
                self._means = _chart('control chart of the means')
            with panel('Control chart: standard deviations'):
                self._spreads = _chart('control chart of the standard deviations')
            with panel('Zero'):
                self._zero = _chart('zero of the empty belt')
            with panel('Empty belt'):
                self._spectrum = _chart('spectrum of the empty belt')
                self._lines = Table(('Hz', 'g', 'what it might be'))
        ui.timer(_PERIOD, self._update)
        ui.timer(_SLOW_PERIOD, self._update_machine)

    def _update(self) -> None:
        if self._version == self._lane.version:
            return
        self._version = self._lane.version
        items = self._lane.items()
        if items:
            self._item = items[0]
            self._show_item(self._item)
        listed = self._lane.faults() if self._only_faults.value else items
        kept = (item for item in listed if self._kept in (None, item.key))
        self._show_signal(next(kept, None))
        self._show_stop()
        self._show_list(listed)
        if not items or items[0].key == self._counted:
            return
        self._counted = items[0].key
        _set(self._histogram, charts.histogram(items, self._lane.statistics))
        chart = control_chart(charts.masses_of(items).tolist())
        _set(self._means, charts.control_figure(chart, spread=False))
        _set(self._spreads, charts.control_figure(chart, spread=True))
        _set(self._zero, charts.zero_chart(items))
        self._show_production(self._lane.statistics)

    def _show_item(self, item: Item) -> None:
        verdict = item.verdict
        name = verdict.decision.name
        self._decision.set_text(f'{_SIGNS[name]} {name}')
        self._decision.classes(replace=f'decision {name}')
        self._mass.set_text(_grams(verdict.mass, ' g', digits=2))
        parts = [f'item {verdict.item_id}']
        if math.isfinite(verdict.std_dev):
            parts.append(f'± {GRAMS * verdict.std_dev:.2f} g')
        if item.estimate is not None:
            if math.isfinite(item.estimate.belt_speed):
                parts.append(f'{60 * item.estimate.belt_speed:.1f} m/min')
            parts.append(item.estimate.estimator)
        if math.isfinite(item.reference):
            parts.append(f'reference {GRAMS * item.reference:.2f} g')
        self._about.set_text(', '.join(parts))
        self._why.set_text('; '.join(f'{each}: {_hint(each)}' for each in verdict.reasons))

    def _show_signal(self, item: Item | None) -> None:
        if item is None:  # so old that it is not known any more
            return
        item = self._signalled = self._lane.with_signals(item)
        stretch, cell = item.stretch, self._lane.load_cell
        # That of a fault grows until some of what follows is there, too.
        size = 0 if stretch is None else len(stretch.time)
        state = item.key, item.window is not None, size, item.t4
        if state != self._drawn:
            self._drawn = state
            verdict = item.verdict
            when = clock(verdict.t3 or verdict.t1)
            self._about_signal.set_text(f'item {verdict.item_id} at {when}: {said(verdict)}')
            _set(self._signal, charts.signal_chart(item, cell))
            self._show_marks(fault_marks(item, stretch, cell) if stretch and cell else [])
        self._latest.set_visibility(self._kept is not None)

    def _show_marks(self, marks: Iterable[Mark]) -> None:
        self._marks.clear()
        with self._marks:
            for mark in marks:
                with ui.element('li'):
                    ui.label(mark.text)

    async def _keep_shown(self) -> None:
        if self._keep is not None and self._signalled is not None:
            await self._keep(self._signalled)

    def _show_latest(self) -> None:
        self._kept = None
        self._again()

    def _choose(self, key: Key) -> None:
        self._kept = key
        self._again()

    def _again(self) -> None:
        """Show everything at the next update."""
        self._version = None

    def _show_stop(self) -> None:
        stop = self._lane.stop
        stopped = stop is not None and stop.reason != ''
        self._stop.set_text(f'STOP {stop.reason}: {stop.hint}' if stopped and stop else '')

    def _show_list(self, items: list[Item]) -> None:
        """Show the items; rows that stay are kept, and with them the focus of the keyboard."""
        shown = {item.key: item for item in items[:_SHOWN]}
        for key in self._rows.keys() - shown.keys():
            self._rows.pop(key)[0].delete()
        for number, (key, item) in enumerate(shown.items()):
            row, known = self._rows.get(key, (None, None))
            if row is None:
                with self._list:
                    row = ui.element('tr')
                row.move(target_index=number)
            if item != known:
                row.clear()
                with row:
                    self._fill(item)
                self._rows[key] = row, item
            row.classes(
                add='chosen' if key == self._kept else '',
                remove='' if key == self._kept else 'chosen',
            )

    def _fill(self, item: Item) -> None:
        verdict = item.verdict
        with ui.element('td'):
            button = ui.button(str(verdict.item_id), on_click=lambda: self._choose(item.key))
            button.props(f'flat dense aria-label="show item {verdict.item_id}"')
        for text in (
            clock(verdict.t3 or verdict.t1), _grams(verdict.mass), _grams(verdict.std_dev),
            _grams(item.reference), said(verdict),
        ):  # fmt: skip
            _cell(text)

    def _show_production(self, statistics: Statistics | None) -> None:
        rows = [('', 'no statistics: the node product does not run')]
        if statistics is not None:
            rows = [
                ('product', statistics.product or 'none'), ('batch', statistics.batch or 'none'),
                ('items', str(statistics.items)), ('accepted', str(statistics.accepted)),
                ('under', str(statistics.under)), ('over', str(statistics.over)),
                ('faults', str(statistics.faults)),
                *((name, str(count)) for name, count in zip(
                    statistics.reasons, statistics.reason_counts, strict=True)),
                ('mean g', _grams(statistics.mean)), ('std dev g', _grams(statistics.std_dev)),
                ('giveaway g', _grams(statistics.giveaway)),
                ('below TU1', str(statistics.below_tu1)), ('below TU2', str(statistics.below_tu2)),
                ('items/min', _number(statistics.throughput, 1)),
            ]  # fmt: skip
        self._production.show(rows)

    def _update_machine(self) -> None:
        if self._board is None:
            if self._analysed == self._lane.version:
                return
            self._analysed = self._lane.version
            self._show_reasons(self._lane.statistics)
        else:
            self._show_diagnostics(self._board)
        self._show_spectrum()

    def _show_reasons(self, statistics: Statistics | None) -> None:
        """Show why items were faults, the most frequent reason first."""
        counts = (
            dict(zip(statistics.reasons, statistics.reason_counts, strict=True))
            if statistics
            else {}
        )
        self._headline.set_text('' if counts else 'no fault until now')
        self._diagnostics.show(
            (str(counts[each]), each, _hint(each))
            for each in sorted(counts, key=counts.__getitem__, reverse=True)
        )

    def _show_diagnostics(self, board: StatusBoard) -> None:
        rows = [
            row
            for row in board.rows(time.monotonic())
            if row.node.strip('/').rpartition('/')[0] == self._lane.name
        ]
        self._headline.set_text(headline(rows))
        shown = [row for row in rows if row.level != Level.OK]
        self._diagnostics.show(
            (row.level.name, f'{row.node} {row.aspect}', row.message) for row in shown
        )

    def _show_spectrum(self) -> None:
        cell = self._lane.load_cell
        if cell is None:
            return
        known = self._item.estimate if self._item is not None else None
        speed = known.belt_speed if known is not None else math.nan
        platform = known.natural_frequency if known is not None else math.nan
        found = spectrum(self._lane.empty_belt(), cell.sample_rate, speed, platform)
        _set(self._spectrum, charts.spectrum_chart(found))
        lines = found.lines if found else ()
        self._lines.show(
            (f'{each.frequency:.1f}', _grams(each.amplitude), each.guess) for each in lines
        )


def list_lanes(lanes: Mapping[str, Lane]) -> None:
    """Show links to the lanes, and again when one more is found."""
    known = len(lanes)
    if not known:
        ui.label('no lane runs yet; is the line running, and in this ROS_DOMAIN_ID?')
    for name in sorted(lanes):
        ui.link(name or '(no namespace)', f'/lane/{name}')
    ui.timer(_SLOW_PERIOD, lambda: ui.navigate.reload() if len(lanes) != known else None)


def said(verdict: Verdict) -> str:
    """Return a verdict in words, with its reasons."""
    name = verdict.decision.name
    return ' '.join((_SIGNS[name], name, ', '.join(verdict.reasons))).rstrip()


def panel(title: str) -> Element:
    """Return a part of the page with a heading."""
    panel = ui.element('section').classes('panel').props(f'aria-label="{title}"')
    with panel:
        ui.html(f'<h2>{title}</h2>', sanitize=False)
    return panel


def _chart(label: str) -> ui.echart:
    options = charts.nothing('waiting for items')
    return ui.echart(options).classes('chart').props(f'role=img aria-label="{label}"')


def _set(chart: ui.echart, options: charts.Options) -> None:
    if chart.options != options:
        # As it is: NiceGUI would make an observed list of each point, most of the page's work.
        dict.__setitem__(chart.props, 'options', options)
        chart.update()


class Table:
    """A table whose texts change in place: most stay as they are, and elements are dear."""

    def __init__(self, heads: tuple[str, ...]) -> None:
        self._columns = len(heads)
        self._body = _table_of(heads)
        self._rows: list[tuple[Element, list[ui.label]]] = []

    def show(self, rows: Iterable[tuple[str, ...]]) -> None:
        """Show rows, each with a text for each column."""
        given = list(rows)
        while len(self._rows) > len(given):
            self._rows.pop()[0].delete()
        while len(self._rows) < len(given):
            with self._body, ui.element('tr') as row:
                self._rows.append((row, [_cell('') for _ in range(self._columns)]))
        for (_, cells), texts in zip(self._rows, given, strict=True):
            for cell, text in zip(cells, texts, strict=True):
                cell.set_text(text)
            first = texts[0]
            cells[0].classes(replace=f'level-{first}' if first in Level.__members__ else '')


def _table_of(heads: Iterable[str]) -> Element:
    """Return the body of a table."""
    with ui.element('table').classes('plain'):
        with ui.element('thead'), ui.element('tr'):
            for head in heads:
                with ui.element('th').props('scope=col'):
                    ui.label(head)
        return ui.element('tbody')


def _cell(text: str) -> ui.label:
    with ui.element('td'):
        return ui.label(text)


def _grams(mass: float, unit: str = '', digits: int = 3) -> str:
    return _number(GRAMS * mass, digits, unit)


def _number(value: float, digits: int, unit: str = '') -> str:
    return f'{value:.{digits}f}{unit}' if math.isfinite(value) else '–'


def clock(stamp: int | None) -> str:
    """Return the time of a stamp on the clock of this machine."""
    if stamp is None:
        return '–'
    return f'{datetime.fromtimestamp(stamp / NANOSECONDS, UTC).astimezone():%H:%M:%S}'


def _hint(reason: str) -> str:
    known = reason in Reason.__members__.values()
    return Reason(reason).hint if known else 'a reason that this version does not know'

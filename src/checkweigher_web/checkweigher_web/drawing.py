# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a lane shows, drawn once for all who look at it."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
import math
import time
from typing import Any, TypeVar

from nicegui import json

from checkweigher_core.records import GRAMS
from checkweigher_core.records.reasons import Reason
from checkweigher_production.control_chart import control_chart
from checkweigher_web import charts
from checkweigher_web.empty_belt import Line, spectrum
from checkweigher_web.fault_marks import empty_reading, fault_marks
from checkweigher_web.lane import Item, Key, Lane
from checkweigher_web.shift import Playback
from checkweigher_web.words import clock, grams, said

_SHOWN = 100  # items in the list
_BELT_PERIOD = 1.0  # s; the spectrum takes longer than all else
T = TypeVar('T')


@dataclass(frozen=True, slots=True)
class Signal:
    """The signal of an item as a figure, and what broke in words."""

    figure: str
    marks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Overview:
    """Figures over the latest items."""

    masses: str
    means: str
    spreads: str
    zero: str


@dataclass(frozen=True, slots=True)
class Belt:
    """The spectrum of the empty belt as a figure, and its lines."""

    figure: str
    lines: tuple[Line, ...]


class Drawing:
    """Figures and lists of a lane as JSON, made when the first viewer asks for them.

    Twenty viewers then cost little more than one. It is used by the thread of the page alone.
    """

    def __init__(self, lane: Lane | Playback) -> None:
        self.lane = lane
        self._made: dict[Hashable, tuple[object, Any]] = {}
        self._signals: dict[Key, Signal] = {}
        self._version: object = None  # of the lane, for `_signals`
        self._readings: dict[Key, float] = {}  # of the empty belt before items, kg
        self._belt_due = -math.inf  # s

    def _once(self, name: Hashable, state: object, make: Callable[[], T]) -> T:
        """Return what was made of a name in the same state, or make it."""
        known = self._made.get(name)
        if known is None or known[0] != state:
            known = self._made[name] = state, make()
        return known[1]

    def items(self, *, only_faults: bool = False) -> list[Item]:
        """Return the items, or the faults among them, without their signals, the latest first."""
        make = self.lane.faults if only_faults else self.lane.items
        return self._once(('items', only_faults), self.lane.version, make)

    def rows(self, *, only_faults: bool = False) -> str:
        """Return the rows of the list of items."""
        items = self.items(only_faults=only_faults)[:_SHOWN]
        return self._once(
            ('rows', only_faults), self.lane.version, lambda: json.dumps([_row(e) for e in items])
        )

    def signal(self, item: Item) -> Signal:
        """Return the signal of an item; that of a fault grows until what follows is there, too."""
        if self._version != self.lane.version:
            self._version = self.lane.version
            self._signals.clear()
        if item.key not in self._signals:
            self._signals[item.key] = self._draw_signal(item)
        return self._signals[item.key]

    def _draw_signal(self, item: Item) -> Signal:
        known, cell = self.lane.with_signals(item), self.lane.load_cell
        marks = fault_marks(known, known.stretch, cell) if known.stretch and cell else []
        figure = json.dumps(charts.signal_chart(known, cell))
        return Signal(figure, tuple(mark.text for mark in marks))

    def overview(self) -> Overview:
        """Return the figures over the items."""
        items, known = self.items(), self.lane.statistics
        of = (known.product, known.batch) if known is not None else None
        state = (items[0].key if items else None), of
        return self._once('overview', state, lambda: self._draw_overview(items))

    def _draw_overview(self, items: Sequence[Item]) -> Overview:
        series, latest = self.lane.series, items[0].verdict if items else None
        chart = control_chart([GRAMS * mass for mass in series.masses])
        figures = (
            charts.histogram(series, latest, self.lane.statistics),
            charts.control_figure(chart, series.forgotten, spread=False),
            charts.control_figure(chart, series.forgotten, spread=True),
            charts.zero_chart(items, self._read_empty_belts(items)),
        )
        return Overview(*map(json.dumps, figures))

    def _read_empty_belts(self, items: Sequence[Item]) -> dict[Key, float]:
        """Return what the belt read before the items whose zero could not be trusted, kg, or NaN.

        It is read when they come: the samples of a lane are soon gone.
        """
        known, cell = self._readings, self.lane.load_cell
        self._readings = {}
        for item in items:
            if cell is None or Reason.ZERO_OUT_OF_RANGE not in item.verdict.reasons:
                continue
            if item.key not in known:
                stretch = self.lane.with_signals(item).stretch
                known[item.key] = empty_reading(item, stretch, cell) if stretch else math.nan
            self._readings[item.key] = known[item.key]
        return self._readings

    def belt(self) -> Belt | None:
        """Return the spectrum of the empty belt, None before the load cell is known."""
        if self.lane.load_cell is None:
            return None
        if isinstance(self.lane, Playback):
            return self._once('belt', self.lane.version, self._draw_belt)
        now = time.monotonic()
        if now >= self._belt_due:
            self._belt_due = now + _BELT_PERIOD
        return self._once('belt', self._belt_due, self._draw_belt)

    def _draw_belt(self) -> Belt:
        items, cell = self.items(), self.lane.load_cell
        assert cell is not None
        known = items[0].estimate if items else None
        speed = known.belt_speed if known is not None else math.nan
        platform = known.natural_frequency if known is not None else math.nan
        found = spectrum(self.lane.empty_belt(), cell.sample_rate, speed, platform)
        return Belt(json.dumps(charts.spectrum_chart(found)), found.lines if found else ())


def row_key(key: Key) -> str:
    """Return the key of an item as a text: numbers of JavaScript hold no stamp."""
    return f'{key[0]}/{key[1]}'


def _row(item: Item) -> list[str]:
    verdict = item.verdict
    return [
        row_key(item.key), str(verdict.item_id), verdict.decision.name,
        clock(verdict.t3 or verdict.t1), grams(verdict.mass), grams(verdict.std_dev),
        grams(item.reference), said(verdict),
    ]  # fmt: skip


EMPTY = json.dumps(charts.nothing('waiting for items'))

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the items in the last hour, or in a recorded shift, on one time axis."""

from collections.abc import Mapping, Sequence
import math
import time

from nicegui import json, ui
from nicegui.events import GenericEventArguments
import numpy as np

from checkweigher_core.records import GRAMS, NANOSECONDS, Alarm, Decision
from checkweigher_core.records.reasons import Reason
from checkweigher_web import charts
from checkweigher_web.charts import ALARM, DENOISED, INK, MUTED, Options
from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.elements import Figure
from checkweigher_web.history import HOUR, History, intervals
from checkweigher_web.lane import MAX_ITEMS, Key, ShownItem
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.views.fault_marks import Scene, empty_belt
from checkweigher_web.views.view import SLOW, View

_INTERVALS = 60
# Shortest interval in ns.
_SHORTEST = 10 * NANOSECONDS
# Period in s after which the figure of a running lane with `MAX_ITEMS` items is drawn again.
_RARELY = 10
# Width in ns of a bin. The accepted items in a bin share one tick.
_TICK = NANOSECONDS // 2
# Heights of the charts in px, from top to bottom.
_HEIGHTS = 34, 62, 84, 62, 50, 34


# Messages if there is no further item in one direction. Each key contains whether only faults are
# wanted, and whether the direction is towards later items.
_NO_MORE = {
    (False, True): Text('no item after it'),
    (False, False): Text('no item before it'),
    (True, True): Text('no fault after it'),
    (True, False): Text('no fault before it'),
}


class HourView(View):
    """Ticks for the items, above charts with the same time axis.

    The signal, the item list, the histogram and the control charts show only the items in the part
    of the time axis that the viewer has selected.
    """

    title = Text('Over time')
    columns = 2, 12
    period = SLOW

    def _build(self) -> None:
        with ui.element('div').classes('in-a-row'):
            for text, step, faults in (
                (Text('previous item'), -1, False),
                (Text('next item'), 1, False),
                (Text('previous fault'), -1, True),
                (Text('next fault'), 1, True),
            ):
                button = ui.button(
                    self.say(text), on_click=lambda s=step, f=faults: self._move(s, f)
                )
                button.props('outline')
            self._whole = ui.button(self.say('whole time'), on_click=lambda: self._select(None))
            self._whole.props('outline')
            self._where = ui.label('').classes('where').props('role=status')
        self._figure = Figure(self.say('items over time'), self.say, linked=True)
        self._figure.props('role=slider tabindex=0')
        self._figure.on('span', self._zoom)
        self._figure.on('at', self._choose_at)
        self._figure.on('keydown.left.prevent', lambda: self._move(-1, False))
        self._figure.on('keydown.right.prevent', lambda: self._move(1, False))
        self._figure.on('keydown.home.prevent', lambda: self._move(-math.inf, False))
        self._figure.on('keydown.end.prevent', lambda: self._move(math.inf, False))

    def _state(self) -> object:
        return self.lane.version, self.look.chosen, self.look.span

    def _show(self) -> None:
        self._figure.show_text(hour(self.drawing, self.say, live=self.look.board is not None))
        self._whole.set_visibility(self.look.span is not None)
        place, count = self.look.place()
        item = self.look.item()
        where = ''
        if item is not None:
            where = self.say(
                'item {place} of {count}, {time}',
                place=place,
                count=count,
                time=self.say.clock(item.verdict.time),
            )
        self._where.set_text(where)
        values = {'aria-valuemin': 1, 'aria-valuemax': count, 'aria-valuenow': place}
        self._figure.props.update(values | {'aria-valuetext': where})

    def _move(self, step: float, faults: bool) -> None:
        if not self.look.move(step, faults=faults):
            ui.notify(self.say(_NO_MORE[faults, step > 0]))
        self.update()

    def _select(self, span: tuple[int, int] | None) -> None:
        self.look.span = span
        if span is None:
            self._figure.run_method('whole')
        self.update()

    def _zoom(self, event: GenericEventArguments) -> None:
        self._select(event.args and tuple(charts.stamp_of(each) for each in event.args))

    def _choose_at(self, event: GenericEventArguments) -> None:
        stamp = charts.stamp_of(event.args)
        items = [item for item in self.look.items() if item.times]
        if items:
            nearest = min(items, key=lambda item: abs(max(item.times.values()) - stamp))
            self.look.choose(row_key(nearest))
            self.update()


def hour(drawing: Drawing, say: Language = ENGLISH, *, live: bool) -> str:
    """Return the figure of the last hour, or of a whole recorded shift, as JSON.

    The figure is cached until the records of the lane change. If `MAX_ITEMS` items are known, the
    figure of a running lane is drawn only every `_RARELY` s.
    """
    many = len(drawing.items()) >= MAX_ITEMS  # whether the item list of a running lane is full
    now = int(time.monotonic() / _RARELY) if many and live else drawing.lane.version
    return drawing.once(('hour', say), now, lambda: json.dumps(_draw(drawing, say, live=live)))


def _draw(drawing: Drawing, say: Language, *, live: bool) -> Options:
    history = drawing.lane.history()
    if not len(history.stamps):
        return charts.nothing(say('waiting for items'))
    end = time.time_ns() if live else int(history.stamps.max()) + 1
    # End at the last item if the source has another clock, or if the line has stood for an hour.
    if live and not 0 <= end - history.stamps[-1] < HOUR:
        end = int(history.stamps[-1]) + 1
    begin = max(int(history.stamps.min()), end - HOUR) if live else int(history.stamps.min())
    readings = _read_empty_belts(drawing)
    return hour_figure(history, drawing.lane.alarms, readings, begin, end, say)


def hour_figure(
    history: History,
    alarms: Sequence[Alarm],
    readings: Mapping[int, float],
    begin: int,
    end: int,
    say: Language = ENGLISH,
) -> Options:
    """Return the figure of a history from `begin` to `end` in ns.

    `readings` contains the reading of the empty belt in g before each item with the reason
    ZERO_OUT_OF_RANGE, by t1 of the item in ns. An unknown reading is NaN.
    """
    count = min(_INTERVALS, max(2, (end - begin) // _SHORTEST))
    means = intervals(history, begin, end, count)
    at = charts.local_times(means.times)
    scale = say.per_kg / GRAMS
    times, noise = charts.local_times(history.noise[:, 0]), scale * history.noise[:, 1]
    rows = {
        say('items'): _ticks(history, say),
        say('items/min'): [charts.line(say('items/min'), at, means.rates, DENOISED, width=2)],
        say('gross, {unit}', unit=say.unit): _band(
            at, scale * means.means, scale * means.std_devs, say
        ),
        say('zero, {unit}', unit=say.unit): [
            charts.line(say('zero'), at, scale * means.zeros, DENOISED, width=2),
            *_read(readings, say),
        ],
        say('noise, {unit}', unit=say.unit): [
            charts.line(say('noise'), times, noise, DENOISED, width=2)
        ],
        say('events'): [
            *_events(say('alarm'), _alarm_events(alarms, say), 'triangle', ALARM),
            *_events(say('change'), [(s, say(t)) for s, t in history.changes], 'diamond', INK),
        ],
    }
    heights = dict(zip(rows, _HEIGHTS, strict=True))
    # Omit charts without data. A recording, for example, has neither noise nor alarms.
    shown = {name: own for name, own in rows.items() if any(each['data'] for each in own)}
    ends = charts.local_times([begin - NANOSECONDS, end + NANOSECONDS])
    return charts.rows([*shown.values()], {name: heights[name] for name in shown}, ends)


def _ticks(history: History, say: Language) -> list[Options]:
    """Return the ticks of the items. Only the ticks of items that are not accepted are coloured."""
    series = []
    for name, decisions, color, width in (
        ('ACCEPT', (Decision.ACCEPT,), MUTED, 1),
        (Text('UNDER, OVER'), (Decision.UNDER, Decision.OVER), '--amber', 3),
        ('FAULT', (Decision.FAULT,), ALARM, 3),
    ):
        stamps = history.stamps[np.isin(history.decisions, decisions)]
        if decisions == (Decision.ACCEPT,):
            stamps = np.unique(stamps // _TICK) * _TICK
        at = charts.local_times(stamps)
        mark = charts.symbols(say(name), at, np.zeros(len(at)), 'rect', 0)
        series.append(mark | {'symbolSize': [width, 26], 'color': color, 'silent': True,
                              'tooltip': {'show': False}})  # fmt: skip
    return series


def _band(at: np.ndarray, mean: np.ndarray, std_dev: np.ndarray, say: Language) -> list[Options]:
    lower, upper = (
        charts.line(name, at, values, DENOISED, width=1, dash='dashed')
        for name, values in (
            (say('mean - s'), mean - std_dev),
            (say('mean + s'), mean + std_dev),
        )
    )
    return [charts.line(say('mean'), at, mean, DENOISED, width=2), lower, upper]


def _read(readings: Mapping[int, float], say: Language) -> list[Options]:
    stamps = sorted(stamp for stamp, mass in readings.items() if math.isfinite(mass))
    if not stamps:
        return []
    values = say.per_kg / GRAMS * np.array([readings[stamp] for stamp in stamps])
    name = say('as read, {reason}', reason=Reason.ZERO_OUT_OF_RANGE.value)
    return [charts.symbols(name, charts.local_times(stamps), values, 'diamond', 10)]


def _alarm_events(alarms: Sequence[Alarm], say: Language) -> list[tuple[int, str]]:
    return [(each.first, f'{say(each.source)} {each.reason}') for each in alarms]


def _events(name: str, events: Sequence[tuple[int, str]], symbol: str, color: str) -> list[Options]:
    at = charts.local_times([stamp for stamp, _ in events])
    marks = charts.symbols(name, at, np.zeros(len(at)), symbol, 14)
    data = [
        {'name': text, 'value': point}
        for (_, text), point in zip(events, marks['data'], strict=True)
    ]
    return [marks | {'data': data, 'color': color, 'tooltip': {'formatter': '{b}'}}]


def _read_empty_belts(drawing: Drawing) -> dict[int, float]:
    """Return the reading of the empty belt in g before each item with ZERO_OUT_OF_RANGE.

    The keys are the times t1 of the items in ns. Items without t1 are left out. A reading is NaN if
    the samples of the empty belt are missing. The readings are cached, because the lane soon drops
    its samples.
    """
    readings: dict[Key, float] = drawing.once('readings', None, dict)
    cell = drawing.lane.load_cell
    items = {item.key: item for item in drawing.items() if _is_out(item)}
    for key in readings.keys() - items.keys():
        del readings[key]
    for key in items.keys() - readings.keys():
        item = drawing.lane.with_signals(items[key])
        found = empty_belt(Scene(item, item.stretch, cell)) if item.stretch and cell else None
        readings[key] = math.nan if found is None else GRAMS * found[2]
    return {key[0]: reading for key, reading in readings.items() if key[0] is not None}


def _is_out(item: ShownItem) -> bool:
    return Reason.ZERO_OUT_OF_RANGE in item.verdict.reasons

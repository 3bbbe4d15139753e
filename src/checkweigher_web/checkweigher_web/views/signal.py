# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the signal of an item. For a fault, the view shows the raw signal with marks."""

from collections.abc import Sequence
import math

from nicegui import json, ui
import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import Eye, LoadCell, WeighWindow
from checkweigher_web import charts
from checkweigher_web.charts import ALARM, DENOISED, LEVEL, OTHERS, RAW, REFERENCE, Options
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import Figure, Lines
from checkweigher_web.lane import ShownItem
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.languages.words import said, why
from checkweigher_web.views.fault_marks import EDGES, EYES, Mark, Scene, expected_rise, fault_marks
from checkweigher_web.views.view import FAST, View

# Colour of the bars of each eye, and position of these bars on the y axis.
_ROWS = {Eye.INFEED: (DENOISED, 1.0), Eye.OUTFEED: (LEVEL, 0.0)}
# Maximum number of earlier items whose signals are drawn behind the signal of an item, and
# approximate number of points of each of these signals.
_BEFORE, _POINTS = 20, 60
_DETAIL = 110  # height in px of the figure of the plateau
_LEAD = 0.5  # longest time before t1 that is shown, as a fraction of t3 - t1.

# Time in ms of an edge, whether the eye becomes blocked, and whether the edge was detected.
Edge = tuple[float, bool, bool]
Signal = tuple[ShownItem, list[WeighWindow]]  # item with its signals, and windows of earlier items.
# Points of the bars as data of ECharts lines, by whether both ends of a bar were detected.
Bars = dict[bool, list[list[float | None]]]


class SignalView(View):
    """Signal of the chosen or latest item, drawn over the signals of earlier items."""

    title = Text('Signal')
    columns = 1, 7
    period = FAST

    def _build(self) -> None:
        self._item: ShownItem | None = None
        self._about = ui.label('').classes('about')
        self._figure = Figure(self.say('signal of the item'), self.say)
        self._why = ui.label('').classes('level-ERROR')
        self._marks = Lines().classes('marks')
        with ui.element('div').classes('in-a-row'):
            text = self.say('show the latest item')
            self._latest = ui.button(text, on_click=lambda: self.look.choose(''))
            self._latest.props('outline')
            if self.look.keep is not None:
                keep = ui.button(self.say('keep this item'), on_click=self._keep)
                keep.props('outline')

    def _show(self) -> None:
        self._latest.set_visibility(bool(self.look.chosen))
        item = self.look.item()
        if item is None:
            return
        self._item = item
        figure, marks = drawn(self.drawing, item, self.say)
        self._about.set_text(item_text(item, self.say))
        self._why.set_text(why(item.verdict, self.say))
        self._figure.show_text(figure)
        self._marks.show(marks)

    async def _keep(self) -> None:
        if self.look.keep is not None and self._item is not None:
            await self.look.keep(self._item)


def item_text(item: ShownItem, say: Language) -> str:
    """Return the number, time and verdict of an item."""
    return say(
        'item {number} at {time}: {verdict}',
        number=item.verdict.item_id,
        time=say.clock(item.verdict.time),
        verdict=said(item.verdict, say),
    )


def drawn(
    drawing: Drawing, item: ShownItem, say: Language = ENGLISH
) -> tuple[str, tuple[str, ...]]:
    """Return the figure of an item as JSON and the texts of its marks, which are cached."""
    made = drawing.once(('signals', say), drawing.lane.version, dict)
    if item.key not in made:
        signal = signal_of(drawing, item)
        made[item.key] = signal_texts(*signal, drawing.lane.load_cell, say)
    return made[item.key]


def signal_of(drawing: Drawing, item: ShownItem) -> Signal:
    """Return an item with its signals, and the windows of earlier items."""
    lane = drawing.lane
    return lane.with_signals(item), lane.windows_before(item, _BEFORE)


def signal_texts(
    item: ShownItem, before: Sequence[WeighWindow], load_cell: LoadCell | None, say: Language
) -> tuple[str, tuple[str, ...]]:
    """Return the figure of an item with its signals as JSON, and the texts of its marks."""
    figure, marks = signal_chart(item, load_cell, before, say)
    return json.dumps(figure), tuple(mark.text for mark in marks)


def signal_chart(
    item: ShownItem,
    load_cell: LoadCell | None,
    before: Sequence[WeighWindow] = (),
    say: Language = ENGLISH,
) -> tuple[Options, list[Mark]]:
    """Return the figure of the signal of an item, and the marks in the figure.

    The figure shows the raw signal if the item has one, otherwise its window. Only a raw signal has
    marks. A window is drawn over the windows of earlier items in `before`. Without a signal, the
    figure contains only a text.
    """
    if item.stretch is not None and load_cell is not None:
        scene = Scene(item, item.stretch, load_cell, say)
        marks = fault_marks(scene)
        return _scene_chart(scene, marks), marks
    if item.window is not None and len(item.window.counts):
        return _window_chart(item, item.window, before, say), []
    return charts.nothing(say('no signal: it came before this page was open')), []


def _window_chart(
    item: ShownItem, window: WeighWindow, before: Sequence[WeighWindow], say: Language
) -> Options:
    origin, scale = window.t1 or window.stamp, say.per_kg
    time = _times(window)
    raw = charts.line(say('raw'), time, scale * window.force, RAW, width=1)
    series = [*_overlaid(before, say), raw]
    plateau = slice(window.window_begin, max(window.window_end, window.window_begin + 1))
    force = scale * window.force[plateau]
    detail = [charts.line(say('raw, t2 to t3'), time[plateau], force, RAW, width=1)]
    if len(window.denoised):
        denoised = scale * window.denoised
        series.append(charts.line(say('denoised'), time, denoised, DENOISED, width=2))
        name = say('denoised, t2 to t3')
        detail.append(charts.line(name, time[plateau], denoised[plateau], DENOISED, width=2))
    mass, margin = scale * item.verdict.mass, 2 * scale * item.verdict.std_dev
    if math.isfinite(mass):
        ends = time[plateau][[0, -1]]
        band = [
            {'yAxis': mass - margin, 'xAxis': ends[0]},
            {'yAxis': mass + margin, 'xAxis': ends[1]},
        ]
        shade = {'color': LEVEL, 'opacity': 0.2}
        area = {'markArea': {'silent': True, 'data': [band], 'itemStyle': shade}}
        for name, shown in ((say('mass ± 2 s'), series), (say('mass, t2 to t3'), detail)):
            shown.append(charts.line(name, ends, np.full(2, mass), LEVEL, width=3) | area)
    if math.isfinite(item.reference):
        known, name = np.full(2, scale * item.reference), say('reference')
        series.append(charts.line(name, time[[0, -1]], known, REFERENCE, width=1, dash='dashed'))
    marks = {'t1': window.t1, 't2': window.t2, 't3': window.t3, 't4': item.t4}
    places = {name: (stamp - origin) / 1e6 for name, stamp in marks.items() if stamp is not None}
    raw['markLine'] = charts.mark_lines(places)
    figure = charts.figure(series, say('ms after {edge}', edge='t1'), say.unit)
    transit = places.get('t3', time[plateau][-1])
    figure['xAxis'] |= {'min': max(time[0], -_LEAD * transit), 'max': max(places.values())}
    _add_detail(figure, detail, say('plateau, ms after t1'))
    return figure


def _times(window: WeighWindow) -> NDArray[np.float64]:
    """Return the times of the samples of a window, shape (n,), in ms after t1.

    If t1 is unknown, the times are relative to the stamp of the window.
    """
    begin = (window.stamp - (window.t1 or window.stamp)) / 1e6
    return begin + 1e3 / window.sample_rate * np.arange(len(window.counts), dtype=np.float64)


def _overlaid(windows: Sequence[WeighWindow], say: Language) -> list[Options]:
    """Return the raw signals of windows as one series, or [] if there are no windows.

    The series contains only about `_POINTS` points of each signal, and a gap after each signal.
    """
    points: list[list[float | None]] = []
    for window in windows:
        step = max(1, len(window.counts) // _POINTS)
        curve = np.column_stack([_times(window), say.per_kg * window.force])[::step]
        points += [*curve.round(2 + say.more_digits).tolist(), [None, None]]
    if not points:
        return []
    nothing = np.zeros(0)
    name = say.plural('last {count} item', 'last {count} items', len(windows))
    drawn = charts.line(name, nothing, nothing, OTHERS, width=1)
    return [drawn | {'data': points, 'silent': True, 'tooltip': {'show': False}}]


def _add_detail(figure: Options, detail: Sequence[Options], name: str) -> None:
    """Add a chart of the plateau with its own scale below a figure. `name` labels its time axis."""
    hidden = {'axisLabel': {'showMinLabel': False, 'showMaxLabel': False}}
    x_axis = {'type': 'value', 'min': 'dataMin', 'max': 'dataMax', 'gridIndex': 1} | hidden
    x_axis |= {'name': name, 'nameLocation': 'middle', 'nameGap': 25}
    sides = {'left': 65, 'right': 50}
    figure['grid'] = [
        sides | {'top': 40, 'bottom': _DETAIL + 105},
        sides | {'height': _DETAIL, 'bottom': 45},
    ]
    figure['xAxis'] = [figure['xAxis'], x_axis]
    figure['yAxis'] = [figure['yAxis'], figure['yAxis'] | {'gridIndex': 1, 'splitNumber': 3}]
    figure['series'] += [each | {'xAxisIndex': 1, 'yAxisIndex': 1} for each in detail]


def _scene_chart(scene: Scene, marks: Sequence[Mark]) -> Options:
    """Return the raw signal around an item with marks, above a row for the state of each eye."""
    say = scene.say
    first, origin = next(
        iter(scene.times.items()), (say('the first sample'), int(scene.stretch.time[0]))
    )
    time = (scene.stretch.time - origin) / 1e6
    raw = charts.line(say('raw'), time, say.per_kg * scene.force, RAW, width=1)
    _number(raw, marks, origin)
    series = [raw]
    expected = expected_rise(scene)
    if expected is not None:
        x, y, name = (expected[0] - origin) / 1e6, say.per_kg * expected[1], say('load by the eyes')
        series.append(charts.line(name, x, y, REFERENCE, width=2, dash='dashed'))
    missing = {mark.edge: (mark.begin - origin) / 1e6 for mark in marks if mark.edge}
    places = [float(time[0]), float(time[-1]), *missing.values()]
    shown = min(places), max(places)
    figure = charts.figure(series, '', say.unit)
    _add_rows_of_eyes(figure, shown, say('ms after {edge}', edge=first), say)
    for eye in _ROWS:
        seen = [((e.stamp - origin) / 1e6, e.blocked, True) for e in scene.edges_of(eye)]
        lost = {name: at for name, at in missing.items() if EDGES[name][0] == eye}
        edges = seen + [(at, EDGES[name][1], False) for name, at in lost.items()]
        # A bar at the left end may belong to this item if the time at which the item blocks the eye
        # is neither known nor computed. The start of such a bar is unknown, so the bar is dashed.
        was_seen = ('t1' if eye == Eye.INFEED else 't3') in {*scene.times, *missing}
        bars = _bars(sorted(edges), _ROWS[eye][1], shown, was_seen=was_seen)
        figure['series'] += _row_of_eye(eye, bars, list(lost.values()), say)
    return figure


def _number(raw: Options, marks: Sequence[Mark], origin: int) -> None:
    """Add numbered marks to the raw signal, as areas for spans and as lines for moments."""
    numbered = [
        (str(number), (mark.begin - origin) / 1e6, (mark.end - origin) / 1e6)
        for number, mark in enumerate(marks, 1)
    ]
    raw['markArea'] = charts.red_areas(mark for mark in numbered if mark[1] < mark[2])
    lines = charts.mark_lines({name: begin for name, begin, end in numbered if begin == end})
    lines['lineStyle'] = {'color': ALARM, 'width': 2, 'type': 'solid'}
    lines['label'] |= {'color': ALARM, 'fontWeight': 'bold', 'fontSize': 14}
    raw['markLine'] = lines


def _add_rows_of_eyes(
    figure: Options, shown: tuple[float, float], name: str, say: Language
) -> None:
    """Add a chart below a figure, with the same time axis and a row for each eye.

    The time axis covers the range `shown` in ms, and `name` is its label.
    """
    upper = figure['xAxis'] | {'min': shown[0], 'max': shown[1]}
    lower = upper | {'gridIndex': 1, 'name': name}
    eyes = {
        'type': 'category',
        'data': [say(EYES[Eye.OUTFEED]), say(EYES[Eye.INFEED])],
        'gridIndex': 1,
    }
    sides = {'left': 80, 'right': 30}
    figure['grid'] = [sides | {'top': 40, 'bottom': 110}, sides | {'height': 50, 'bottom': 45}]
    figure['xAxis'] = [upper | {'axisLabel': {'show': False}}, lower]
    figure['yAxis'] = [figure['yAxis'], eyes | {'axisTick': {'show': False}}]


def _bars(edges: Sequence[Edge], row: float, shown: tuple[float, float], *, was_seen: bool) -> Bars:
    """Return a bar for each period in which an eye was blocked.

    The `edges` are in order of time and include missing edges. The position of the bars on the y
    axis is `row`. The time axis covers the range `shown` in ms. `was_seen` is false if a bar that
    begins at the left end must be drawn dashed, because its start is not known.
    """
    bars: Bars = {True: [], False: []}
    since = (shown[0], was_seen) if edges and not edges[0][1] else None
    for at, blocks, is_seen in edges:
        if blocks:
            since = since or (at, is_seen)
        elif since is not None:
            bars[since[1] and is_seen] += [[since[0], row], [at, row], [None, None]]
            since = None
    if since is not None:
        bars[since[1]] += [[since[0], row], [shown[1], row]]
    return bars


def _row_of_eye(eye: Eye, bars: Bars, lost: Sequence[float], say: Language) -> list[Options]:
    color, row = _ROWS[eye]
    own = {'xAxisIndex': 1, 'yAxisIndex': 1, 'silent': True}
    bar = own | {'type': 'line', 'showSymbol': False, 'color': color, 'connectNulls': False}
    solid = {'width': 12, 'cap': 'butt'}
    name = say('{eye} blocked', eye=EYES[eye])
    series = [bar | {'name': name, 'data': bars[True], 'lineStyle': solid}]
    if bars[False]:
        dashed = {'lineStyle': solid | {'type': [6, 4], 'opacity': 0.6}}
        expected = say('{eye} blocked, as expected', eye=EYES[eye])
        series.append(bar | dashed | {'name': expected, 'data': bars[False]})
    if lost:
        at = np.array(lost)
        missing = charts.symbols(say('missing edge'), at, np.full_like(at, row), 'diamond', 16)
        series.append(missing | own)
    return series

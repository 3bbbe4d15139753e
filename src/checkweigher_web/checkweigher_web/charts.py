# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The figures of the page as options of ECharts, from what a lane has shown."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    Eye,
    LoadCell,
    Statistics,
    Verdict,
    WeighWindow,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_production.control_chart import SUBGROUP, ControlChart
from checkweigher_web.empty_belt import Spectrum
from checkweigher_web.fault_marks import EDGES, Scene, expected_rise, fault_marks, runs
from checkweigher_web.lane import Item, Key, Stretch
from checkweigher_web.mass_series import MassSeries

Options = dict[str, Any]

# Told apart by more than hue: lines also differ in width and dash.
RAW, DENOISED, LEVEL, REFERENCE, ALARM = '#8a94a6', '#1b5fc1', '#0b6e3b', '#7a3e9d', '#b3261e'
_MAX_POINTS = 1200
_BINS = 25
_HIGHEST = 150.0  # Hz, above it no machine shakes a belt
_LEAD = 0.5  # of t3 - t1, that is shown before t1
_ABOVE = 4  # of symbols: ECharts puts lines at 3
# Of a figure on a phone, and of its labels, px.
_NARROWEST, _CHARACTER, _LABEL_HEIGHT, _LABEL_DISTANCE = 200, 7, 14, 5
_ROOM = 0.05  # beside data and limits, of their range


def nothing(text: str) -> Options:
    """Return an empty figure that says why it is empty."""
    style = {'fontSize': 14, 'fontWeight': 'normal', 'color': '#4d5969'}
    return {'title': {'text': text, 'left': 'center', 'top': 'middle', 'textStyle': style}}


def signal_chart(item: Item, load_cell: LoadCell | None) -> Options:
    """Return the signal of an item: its window, or of a fault the raw signal with what broke."""
    if item.stretch is not None and load_cell is not None:
        return _stretch_chart(item, item.stretch, load_cell)
    if item.window is not None and len(item.window.counts):
        return _window_chart(item, item.window)
    return nothing('no signal: it came before this page was open')


def _window_chart(item: Item, window: WeighWindow) -> Options:
    origin = window.t1 or window.stamp
    time = (window.stamp - origin) / 1e6 + 1e3 / window.sample_rate * np.arange(len(window.counts))
    series = [_line('raw', time, GRAMS * window.force, RAW, width=1)]
    if len(window.denoised):
        series.append(_line('denoised', time, GRAMS * window.denoised, DENOISED, width=2))
    mass, std_dev = GRAMS * item.verdict.mass, GRAMS * item.verdict.std_dev
    begin, end = time[window.window_begin], time[max(window.window_end - 1, 0)]
    if math.isfinite(mass):
        level = _line('mass', np.array([begin, end]), np.array([mass, mass]), LEVEL, width=3)
        band = [
            {'yAxis': mass - 2 * std_dev, 'xAxis': begin},
            {'yAxis': mass + 2 * std_dev, 'xAxis': end},
        ]
        level['markArea'] = {'silent': True, 'data': [band],
                             'itemStyle': {'color': LEVEL, 'opacity': 0.15}}  # fmt: skip
        series.append(level)
    if math.isfinite(item.reference):
        known = np.full(2, GRAMS * item.reference)
        series.append(_line('reference', time[[0, -1]], known, REFERENCE, width=1, dash='dashed'))
    marks = {'t1': window.t1, 't2': window.t2, 't3': window.t3, 't4': item.t4}
    places = {name: (stamp - origin) / 1e6 for name, stamp in marks.items() if stamp is not None}
    series[0]['markLine'] = _marks(places)
    figure = _figure(series, 'ms after t1', 'g')
    transit = places.get('t3', end)
    figure['xAxis'] |= {'min': max(time[0], -_LEAD * transit), 'max': max(places.values())}
    return figure


def _stretch_chart(item: Item, stretch: Stretch, load_cell: LoadCell) -> Options:
    """Return the raw signal around an item with what broke marked, above what the eyes saw."""
    known = Scene(item, stretch, load_cell).times
    since, origin = next(iter(known.items()), ('the first sample', int(stretch.time[0])))

    def place(stamp: Any) -> Any:
        return (stamp - origin) / 1e6

    force = GRAMS * (stretch.counts - load_cell.zero_counts) / load_cell.counts_per_kg
    series = [_line('raw', place(stretch.time), force, RAW, width=1)]
    expected = expected_rise(item, stretch, load_cell)
    if expected is not None:
        time, load = place(expected.time), GRAMS * expected.force
        series.append(_line('load by the eyes', time, load, REFERENCE, width=2, dash='dashed'))
    marks = fault_marks(item, stretch, load_cell)
    numbered = [(str(k), place(m.begin), place(m.end)) for k, m in enumerate(marks, 1)]
    series[0]['markArea'] = {
        'silent': True, 'itemStyle': {'color': ALARM, 'opacity': 0.15},
        'label': {'color': ALARM, 'fontWeight': 'bold', 'fontSize': 14},
        'data': [[{'name': n, 'xAxis': b}, {'xAxis': e}] for n, b, e in numbered if e > b],
    }  # fmt: skip
    series[0]['markLine'] = {
        **_marks({n: b for n, b, e in numbered if e == b}),
        'lineStyle': {'color': ALARM, 'width': 2, 'type': 'solid'},
        'label': {'formatter': '{b}', 'color': ALARM, 'fontWeight': 'bold', 'fontSize': 14},
    }
    figure = _figure(series, '', 'g')
    begin, end = place(stretch.time[0]), place(stretch.time[-1])
    missing = {mark.edge: place(mark.begin) for mark in marks if mark.edge}
    begin, end = min([begin, *missing.values()]), max([end, *missing.values()])
    _add_axis_of_eyes(figure, begin, end, f'ms after {since}')
    for eye, color in ((Eye.INFEED, DENOISED), (Eye.OUTFEED, LEVEL)):
        seen = [(place(each.stamp), each.blocked) for each in stretch.edges if each.eye == eye]
        lost = {name: at for name, at in missing.items() if EDGES[name][0] == eye}
        # What begins with an edge that clears has been blocked before, or the one that lacks is it.
        begun = 't1' if eye == Eye.INFEED else 't3'
        was_seen = begun in known or begun in missing
        figure['series'] += _eye_series(eye, color, seen, lost, (begin, end), was_seen=was_seen)
    names = [each['name'] for each in figure['series'] if 'xAxisIndex' not in each]
    figure['legend'] = {'show': len(names) > 1, 'top': 0, 'data': names}
    return figure


def _add_axis_of_eyes(figure: Options, begin: float, end: float, name: str) -> None:
    """Put rows for the eyes below a figure, from `begin` to `end`."""
    upper, lower = figure['xAxis'] | {'min': begin, 'max': end}, dict(figure['xAxis'])
    lower |= {'min': begin, 'max': end, 'gridIndex': 1, 'name': name}
    upper |= {'axisLabel': {'show': False}}
    rows = {'type': 'category', 'data': ['outfeed eye', 'infeed eye'], 'gridIndex': 1,
            'axisTick': {'show': False}}  # fmt: skip
    figure['grid'] = [{'left': 80, 'right': 30, 'top': 40, 'bottom': 110},
                      {'left': 80, 'right': 30, 'height': 50, 'bottom': 45}]  # fmt: skip
    figure['xAxis'], figure['yAxis'] = [upper, lower], [figure['yAxis'], rows]


def _eye_series(
    eye: Eye, color: str, seen: Sequence[tuple[float, bool]], lost: Mapping[str, float],
    shown: tuple[float, float], *, was_seen: bool,
) -> list[Options]:  # fmt: skip
    """Return the row of an eye: a bar while it was blocked, a diamond for an edge that it missed.

    The edges are given by their times, those that were `seen` with whether they block. A bar that
    begins or ends at one that was not seen is dashed.
    """
    edges = [(at, blocks, True) for at, blocks in seen]
    edges += [(at, EDGES[name][1], False) for name, at in lost.items()]
    row, begin = (1.0 if eye == Eye.INFEED else 0.0), (shown[0], was_seen)
    bars: dict[bool, list[list[float | None]]] = {True: [], False: []}  # by whether they were seen
    since = begin if edges and not min(edges)[1] else None  # blocked, and whether that was seen
    for at, blocks, is_seen in sorted(edges):
        if blocks:
            since = since or (at, is_seen)
        elif since is not None:
            bars[since[1] and is_seen] += [[since[0], row], [at, row], [None, None]]
            since = None
    if since is not None:
        bars[since[1]] += [[since[0], row], [shown[1], row]]
    own = {'xAxisIndex': 1, 'yAxisIndex': 1, 'silent': True}
    name = f'{eye.name.lower()} eye blocked'
    series: list[Options] = [{
        'type': 'line', 'name': name, 'showSymbol': False, 'color': color, 'data': bars[True],
        'lineStyle': {'width': 12, 'cap': 'butt'}, 'connectNulls': False, **own,
    }]  # fmt: skip
    if bars[False]:
        style = {'width': 12, 'cap': 'butt', 'type': [6, 4], 'opacity': 0.6}
        series.append(series[0] | {
            'name': f'{name}, as expected', 'data': bars[False], 'lineStyle': style,
        })  # fmt: skip
    if lost:
        series.append({
            'type': 'scatter', 'name': 'missing edge', 'symbol': 'diamond', 'symbolSize': 16,
            'color': ALARM, 'z': _ABOVE, 'itemStyle': {'opacity': 1},
            'data': [[at, row] for at in lost.values()], **own,
        })  # fmt: skip
    return series


def histogram(series: MassSeries, latest: Verdict | None, statistics: Statistics | None) -> Options:
    """Return how often each mass came, with limits, TU1, TU2 and nominal mass.

    The limits are those of the `latest` verdict; the others are shown if the statistics are of the
    same product and batch.
    """
    masses = GRAMS * np.array(series.masses)
    if len(masses) < 2:
        return nothing('needs two accepted items of the batch')
    counts, bounds = np.histogram(masses, bins=min(_BINS, max(5, len(masses) // 4)))
    limits: dict[str, float] = {}
    if latest is not None:
        limits |= {'lower': GRAMS * latest.lower_limit, 'upper': GRAMS * latest.upper_limit}
    of = series.product, series.batch
    if statistics is not None and (statistics.product, statistics.batch) == of:
        for name, value in (('TU1', statistics.tu1), ('TU2', statistics.tu2),
                            ('nominal', statistics.nominal)):  # fmt: skip
            limits[name] = GRAMS * (value + statistics.tare)
    limits = {name: at for name, at in limits.items() if math.isfinite(at)}
    centres = (bounds[:-1] + bounds[1:]) / 2
    bars: Options = {
        'type': 'bar', 'name': 'items', 'barWidth': '95%', 'itemStyle': {'color': DENOISED},
        'data': np.column_stack([centres, counts]).tolist(),
    }  # fmt: skip
    figure = _figure([bars], 'gross, g', 'items')
    places = [bounds[0], bounds[-1], *limits.values()]
    figure['xAxis'] |= {'min': min(places), 'max': max(places)}
    _mark_apart(figure, limits)
    figure['yAxis'] |= {'min': 0, 'minInterval': 1}
    return figure


def control_figure(chart: ControlChart | None, forgotten: int, *, spread: bool) -> Options:
    """Return the means of the subgroups, or their standard deviations, with their limits.

    A point that breaks a rule has a symbol, which the legend explains. `forgotten` subgroups came
    before the first.
    """
    if chart is None:
        return nothing(f'needs two subgroups of {SUBGROUP} accepted items of the batch')
    name, values, limits = 'mean', chart.means, {
        'lower': chart.lower, 'mean': chart.centre, 'upper': chart.upper
    }  # fmt: skip
    rules: Sequence[str] = chart.marks
    if spread:
        name, values = 's', chart.std_devs
        limits = {'mean': chart.spread, 'limit': chart.spread_upper}
        rules = ['beyond the limit' if value > chart.spread_upper else '' for value in values]
    number = forgotten + np.arange(1, len(values) + 1, dtype=float)
    line = _line(name, number, values, DENOISED, width=2)
    line |= {'showSymbol': True, 'symbolSize': 5, 'markLine': _marks(limits, axis='yAxis')}
    series = [line]
    for rule in sorted(set(rules) - {''}):
        broken = np.array([each == rule for each in rules])
        series.append({
            'type': 'scatter', 'name': rule, 'symbolSize': 14, 'color': ALARM, 'z': _ABOVE,
            'itemStyle': {'opacity': 1}, **_symbol(rule),
            'data': np.column_stack([number[broken], values[broken]]).round(4).tolist(),
        })  # fmt: skip
    figure = _figure(series, 'subgroup', 'g' if spread else 'gross, g')
    figure['xAxis'] |= {'minInterval': 1}
    low, high = (each(*values, *limits.values()) for each in (min, max))
    room = _ROOM * ((high - low) or 1.0)
    figure['yAxis'] |= {'min': low - room, 'max': high + room}
    figure['yAxis']['axisLabel'] |= {'showMaxLabel': False}
    return figure


def _symbol(rule: str) -> Options:
    """Return the symbol of a broken rule of the control chart."""
    if rule.startswith('beyond'):
        return {'symbol': 'diamond'}
    rotated = {'symbolRotate': 180} if rule.endswith('falling') else {}
    return {'symbol': 'rect' if rule.endswith('side') else 'triangle', **rotated}


def zero_chart(items: Sequence[Item], readings: Mapping[Key, float]) -> Options:
    """Return the empty belt before each item, as a distance from the zero of calibration.

    Where the zero could not be trusted the time is marked with that reason, and the empty belt is
    shown as it was read, kg by the key of the item, if it was.
    """
    timed = [each for each in reversed(items) if each.verdict.t1 is not None]
    out = np.array([Reason.ZERO_OUT_OF_RANGE in each.verdict.reasons for each in timed], bool)
    zeros = np.array(
        [math.nan if each.estimate is None else each.estimate.zero for each in timed], float
    )
    shown = np.isfinite(zeros) | out
    if not shown.any():
        return nothing('no item yet')
    zeros, out = GRAMS * zeros[shown], out[shown]
    timed = [each for each, is_shown in zip(timed, shown, strict=True) if is_shown]
    stamps = np.array([each.verdict.t1 for each in timed], np.int64)
    time = (stamps - stamps[0]) / NANOSECONDS
    line = _line('zero', time, zeros, DENOISED, width=2)
    line['data'] = [[at, None if math.isnan(zero) else zero] for at, zero in line['data']]
    # From the last item before to the first one after.
    spans = [(time[max(begin - 1, 0)], time[min(end, len(time) - 1)]) for begin, end in runs(out)]
    name = Reason.ZERO_OUT_OF_RANGE.value
    line['markArea'] = {
        'silent': True, 'itemStyle': {'color': ALARM, 'opacity': 0.15}, 'label': {'color': ALARM},
        'data': [[{'name': name, 'xAxis': begin}, {'xAxis': end}] for begin, end in spans],
    }  # fmt: skip
    series = [line]
    read = GRAMS * np.array([readings.get(each.key, math.nan) for each in timed])
    known = np.isfinite(read)
    if known.any():
        series.append({
            'type': 'scatter', 'name': f'as read, {name}', 'symbol': 'diamond', 'symbolSize': 10,
            'color': ALARM, 'data': np.column_stack([time[known], read[known]]).round(4).tolist(),
        })  # fmt: skip
    figure = _figure(series, 's', 'g')
    figure['xAxis'] |= {'min': time[0], 'max': time[-1]}
    return figure


def spectrum_chart(found: Spectrum | None) -> Options:
    """Return the spectrum of the empty belt with its lines."""
    if found is None:
        return nothing('needs a stretch of the empty belt')
    shown = found.frequencies <= _HIGHEST
    amplitudes = GRAMS * found.amplitudes[shown]
    line = _line('amplitude', found.frequencies[shown], amplitudes, DENOISED, width=1)
    figure = _figure([line], 'Hz', 'g')
    figure['xAxis'] |= {'min': 0, 'max': min(_HIGHEST, float(found.frequencies[-1]))}
    _mark_apart(figure, {f'{each.frequency:.0f}': each.frequency for each in found.lines})
    return figure


def _line(
    name: str, x: NDArray[Any], y: NDArray[Any], color: str, *, width: int,
    dash: str = 'solid',
) -> Options:  # fmt: skip
    step = max(1, -(-len(x) // _MAX_POINTS))
    return {
        'type': 'line', 'name': name, 'showSymbol': False, 'color': color,
        'lineStyle': {'width': width, 'type': dash},
        'data': np.column_stack([x[::step], y[::step]]).round(4).tolist(),
    }  # fmt: skip


def _marks(places: dict[str, float], axis: str = 'xAxis') -> Options:
    return {
        'symbol': 'none', 'silent': True, 'animation': False,
        'lineStyle': {'color': '#595959', 'type': 'dotted'},
        'label': {'formatter': '{b}', 'color': '#333333'},
        'data': [{'name': name, axis: place} for name, place in places.items()],
    }  # fmt: skip


def _mark_apart(figure: Options, places: Mapping[str, float]) -> None:
    """Mark places on the x axis of a figure, one label above the other where they would touch.

    By the width that the figure has on a phone: nothing tells how wide it will be.
    """
    axis = figure['xAxis']
    scale = _NARROWEST / ((axis['max'] - axis['min']) or 1.0)
    marks, ends = _marks(dict(sorted(places.items(), key=lambda each: each[1]))), list[float]()
    for mark in marks['data']:
        half = _CHARACTER * (len(mark['name']) + 1) / 2
        at = scale * (mark['xAxis'] - axis['min'])
        free = [level for level, end in enumerate(ends) if end <= at - half]
        level = free[0] if free else len(ends)
        ends[level : level + 1] = [at + half]
        mark['label'] = {'distance': _LABEL_DISTANCE + _LABEL_HEIGHT * level}
    figure['series'][0]['markLine'] = marks
    figure['grid']['top'] += _LABEL_HEIGHT * max(len(ends) - 1, 0)


def _figure(series: list[Options], x_name: str, y_name: str) -> Options:
    # Scientific data: no animation between two items, and an axis that need not begin at 0.
    return {
        'animation': False, 'tooltip': {'trigger': 'axis'},
        'legend': {'show': len(series) > 1, 'top': 0},
        'grid': {'left': 65, 'right': 50, 'top': 40, 'bottom': 40},
        'xAxis': {'type': 'value', 'name': x_name, 'nameLocation': 'middle', 'nameGap': 25,
                  'min': 'dataMin', 'max': 'dataMax', 'axisLine': {'onZero': False},
                  'axisLabel': {'showMinLabel': False, 'showMaxLabel': False}},
        'yAxis': {'type': 'value', 'name': y_name, 'nameLocation': 'middle', 'nameGap': 45,
                  'scale': True, 'axisLine': {'onZero': False},
                  'axisLabel': {'showMinLabel': False}},
        'series': series,
    }  # fmt: skip

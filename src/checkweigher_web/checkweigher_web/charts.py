# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Functions that return figures, or parts of them, as options of the library ECharts."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

Options = dict[str, Any]

# Colours, as the names of CSS variables in page.css. The browser replaces each name by the colour
# of the variable in the viewer's theme. Lines also differ in width and dash, because some users
# cannot distinguish the colours.
RAW, DENOISED, LEVEL, REFERENCE = '--raw', '--blue', '--green', '--violet'
OTHERS = '--line'
ALARM, INK, MUTED = '--red', '--ink', '--muted'
_MAX_POINTS = 1200
# Width of a figure on a phone, width of a character, height of a label, and distance of the lowest
# label from the chart, in px.
_NARROWEST, _CHARACTER, _LABEL_HEIGHT, _LABEL_DISTANCE = 200, 7, 14, 5
_GAP = 18  # vertical distance in px between charts that share a time axis
_ABOVE = 4  # `z` of symbols in ECharts, so that they are drawn above lines, whose `z` is 3


def nothing(text: str) -> Options:
    """Return an empty figure with a text that explains why it is empty."""
    style = {'fontSize': 14, 'fontWeight': 'normal', 'color': MUTED}
    return {'title': {'text': text, 'left': 'center', 'top': 'middle', 'textStyle': style}}


def figure(series: list[Options], x_name: str, y_name: str) -> Options:
    """Return a figure of `series`, whose axes cover the range of the data and may leave out 0."""
    axis = {'type': 'value', 'axisLine': {'onZero': False}}
    return {
        'animation': False,
        'tooltip': {'trigger': 'axis'},
        'legend': legend(series),
        'grid': {'left': 65, 'right': 50, 'top': 40, 'bottom': 40},
        'xAxis': axis
        | {'name': x_name, 'nameLocation': 'middle', 'nameGap': 25}
        | {'min': 'dataMin', 'max': 'dataMax'}
        | {'axisLabel': {'showMinLabel': False, 'showMaxLabel': False}},
        'yAxis': axis
        | {'name': y_name, 'nameLocation': 'middle', 'nameGap': 45}
        | {'scale': True, 'axisLabel': {'showMinLabel': False}},
        'series': series,
    }


def legend(series: Iterable[Options]) -> Options:
    """Return the legend of `series`, in which lines have the width and dash of the figure.

    The legend is hidden if there are fewer than two series.
    """
    data = [
        {'name': each['name'], 'itemStyle': {'opacity': int(each['type'] != 'line')}}
        for each in series
    ]
    look = {'type': 'scroll', 'lineStyle': {'width': 'inherit'}}
    return look | {'show': len(data) > 1, 'top': 0, 'data': data}


def line(
    name: str, x: NDArray[Any], y: NDArray[Any], color: str, *, width: int, dash: str = 'solid'
) -> Options:
    """Return a line through the points `x`, `y` (n,), thinned to at most `_MAX_POINTS` points.

    `width` is in px. `dash` is the ECharts name of the line style: solid, dashed or dotted.
    """
    step = max(1, -(-len(x) // _MAX_POINTS))
    return {
        'type': 'line',
        'name': name,
        'showSymbol': False,
        'color': color,
        'lineStyle': {'width': width, 'type': dash},
        'data': _points(x[::step], y[::step]),
    }


def symbols(name: str, x: NDArray[Any], y: NDArray[Any], symbol: str, size: int) -> Options:
    """Return red symbols at the points `x`, `y` (n,), which are drawn above all lines.

    `symbol` is the ECharts name of the shape, such as 'diamond', and `size` is its size in px.
    """
    return {
        'type': 'scatter',
        'name': name,
        'symbol': symbol,
        'symbolSize': size,
        'color': ALARM,
        'z': _ABOVE,
        'itemStyle': {'opacity': 1},
        'data': _points(x, y),
    }


def _points(x: NDArray[Any], y: NDArray[Any]) -> list[list[float]]:
    """Return [x, y] pairs, in which x is rounded to 4 decimals.

    y is rounded to 7 decimals, because y may be a mass in kg, or to 4 decimals if any absolute
    value of y exceeds 10.
    """
    largest = np.nanmax(np.abs(y), initial=0.0)
    return np.column_stack([x.round(4), y.round(4 if largest > 10 else 7)]).tolist()


def red_areas(spans: Iterable[tuple[str, float, float]]) -> Options:
    """Return red areas. Each span is the name, the start and the end of an area on the x axis."""
    return {
        'silent': True,
        'itemStyle': {'color': ALARM, 'opacity': 0.15},
        'label': {'color': ALARM, 'fontWeight': 'bold', 'fontSize': 14},
        'data': [[{'name': name, 'xAxis': begin}, {'xAxis': end}] for name, begin, end in spans],
    }


def mark_lines(places: Mapping[str, float], axis: str = 'xAxis') -> Options:
    """Return labelled dotted lines across a figure. `places` maps labels to axis positions.

    `axis` is 'xAxis' for vertical lines, and 'yAxis' for horizontal lines.
    """
    return {
        'symbol': 'none',
        'silent': True,
        'animation': False,
        'lineStyle': {'color': MUTED, 'type': 'dotted'},
        'label': {'formatter': '{b}', 'color': INK},
        'data': [{'name': name, axis: place} for name, place in places.items()],
    }


def mark_apart(figure: Options, places: Mapping[str, float]) -> None:
    """Mark positions on the x axis of a figure with labels that do not overlap.

    `places` maps each label to its position. Labels that would overlap on a phone are stacked,
    because the server does not know the width of the figure in the browser.
    """
    axis = figure['xAxis']
    scale = _NARROWEST / ((axis['max'] - axis['min']) or 1.0)
    marks = mark_lines(dict(sorted(places.items(), key=lambda each: each[1])))
    labels = {mark['name']: scale * (mark['xAxis'] - axis['min']) for mark in marks['data']}
    levels = stacked(labels)
    for mark in marks['data']:
        distance = _LABEL_DISTANCE + _LABEL_HEIGHT * levels[mark['name']]
        mark['label'] = {'distance': distance}
    figure['series'][0]['markLine'] = marks
    figure['grid']['top'] += _LABEL_HEIGHT * max(levels.values(), default=0)


def stacked(labels: Mapping[str, float]) -> dict[str, int]:
    """Return the level (0, 1, ...) of each label, so that labels on one level do not overlap.

    `labels` maps each label to the position of its middle in px. The positions are in increasing
    order.
    """
    ends, levels = list[float](), dict[str, int]()  # right end in px of each level
    for name, at in labels.items():
        half = _CHARACTER * (len(name) + 1) / 2
        free = [level for level, end in enumerate(ends) if end <= at - half]
        level = levels[name] = free[0] if free else len(ends)
        ends[level : level + 1] = [at + half]
    return levels


def local_times(stamps: Sequence[float] | NDArray[Any]) -> NDArray[np.float64]:
    """Return the positions on a time axis, in ms of local time, of stamps (n,) in ns.

    The difference between local time and UTC at the last stamp is used for all stamps.
    """
    found = np.asarray(stamps, np.float64) / 1e6
    return found + (_ahead(found[-1] / 1e3) if len(found) else 0.0)


def stamp_of(position: float) -> int:
    """Return the stamp in ns of a position on a time axis, which is a local time in ms."""
    return round((position - _ahead(position / 1e3)) * 1e6)


def _ahead(seconds: float) -> float:
    """Return the difference in ms between local time and UTC at a Unix time in s."""
    offset = datetime.fromtimestamp(seconds).astimezone().utcoffset()
    return 0.0 if offset is None else 1e3 * offset.total_seconds()


def rows(
    series: Sequence[Sequence[Options]],
    heights: Mapping[str, int],
    ends: Sequence[float] | NDArray[Any],
) -> Options:
    """Return a figure of charts, one below the other, that share one time axis.

    `series` contains the series of each chart, from top to bottom. `heights` maps the name of each
    chart to its height in px. A chart that contains only symbols has no value axis. `ends` contains
    the start and the end of the time axis, as `local_times` returns them. A slider below the charts
    selects a part of the time axis.
    """
    top = _GAP
    figure: Options = {'grid': [], 'xAxis': [], 'yAxis': [], 'series': []}
    for place, (own, (name, height)) in enumerate(zip(series, heights.items(), strict=True)):
        last, events = place == len(heights) - 1, {each['type'] for each in own} == {'scatter'}
        grid = {'left': 70, 'right': 20, 'top': top, 'height': height}
        figure['grid'].append(grid | {'show': True, 'borderColor': '--line'})
        time = {'type': 'time', 'gridIndex': place, 'min': ends[0], 'max': ends[1]}
        time |= {'axisLine': {'onZero': False}}
        hidden = {'axisLabel': {'show': False}, 'axisTick': {'show': False}}
        figure['xAxis'].append(time | ({'axisLabel': {'hideOverlap': True}} if last else hidden))
        value = {'type': 'value', 'gridIndex': place, 'name': name, 'nameLocation': 'middle'}
        value |= {'nameGap': 50, 'scale': True, 'splitNumber': 2}
        flat = {'min': -1, 'max': 1, 'axisLine': {'show': False}, 'splitLine': {'show': False}}
        figure['yAxis'].append(value | (hidden | flat if events else {}))
        figure['series'] += [each | {'xAxisIndex': place, 'yAxisIndex': place} for each in own]
        top += height + _GAP
    every = {'xAxisIndex': [*range(len(heights))], 'filterMode': 'none'}
    inside = {'type': 'inside', 'zoomOnMouseWheel': 'ctrl', 'moveOnMouseWheel': False}
    slider = {'type': 'slider', 'height': 24, 'bottom': 6, 'showDataShadow': False}
    return figure | {
        'height': top + 55,  # height in px, including the slider and the labels of the time axis
        'animation': False,
        'useUTC': True,
        'tooltip': {'trigger': 'axis'},
        'axisPointer': {'link': [{'xAxisIndex': 'all'}]},
        'dataZoom': [slider | every, inside | every],
    }

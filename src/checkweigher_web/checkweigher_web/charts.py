# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the figures, as options of the JavaScript library ECharts."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Options = dict[str, Any]

# Lines also differ in width and dash, because some users cannot distinguish the colours.
RAW, DENOISED, LEVEL, REFERENCE, ALARM = '#8a94a6', '#1b5fc1', '#0b6e3b', '#7a3e9d', '#b3261e'
_MAX_POINTS = 1200
# Width of a figure on a phone, and sizes of its labels, in px.
_NARROWEST, _CHARACTER, _LABEL_HEIGHT, _LABEL_DISTANCE = 200, 7, 14, 5
_ABOVE = 4  # layer of the symbols, which is above layer 3 with the lines


def nothing(text: str) -> Options:
    """Return an empty figure with a text that explains why it is empty."""
    style = {'fontSize': 14, 'fontWeight': 'normal', 'color': '#4d5969'}
    return {'title': {'text': text, 'left': 'center', 'top': 'middle', 'textStyle': style}}


def figure(series: list[Options], x_name: str, y_name: str) -> Options:
    """Return a figure with these series, whose axes cover the range of the data."""
    axis = {'type': 'value', 'axisLine': {'onZero': False}}
    return {
        'animation': False,
        'tooltip': {'trigger': 'axis'},
        'legend': {'show': len(series) > 1, 'top': 0},
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


def line(
    name: str, x: NDArray[Any], y: NDArray[Any], color: str, *, width: int, dash: str = 'solid'
) -> Options:
    """Return a line through the points (n,), or through every k-th point if n is large."""
    step = max(1, -(-len(x) // _MAX_POINTS))
    return {
        'type': 'line',
        'name': name,
        'showSymbol': False,
        'color': color,
        'lineStyle': {'width': width, 'type': dash},
        'data': np.column_stack([x[::step], y[::step]]).round(4).tolist(),
    }


def symbols(name: str, x: NDArray[Any], y: NDArray[Any], symbol: str, size: int) -> Options:
    """Return red symbols at the points (n,), which are drawn above all lines."""
    return {
        'type': 'scatter',
        'name': name,
        'symbol': symbol,
        'symbolSize': size,
        'color': ALARM,
        'z': _ABOVE,
        'itemStyle': {'opacity': 1},
        'data': np.column_stack([x, y]).round(4).tolist(),
    }


def red_areas(spans: Iterable[tuple[str, float, float]]) -> Options:
    """Return red areas. Each span has the name, the start and the end of an area on the x axis."""
    return {
        'silent': True,
        'itemStyle': {'color': ALARM, 'opacity': 0.15},
        'label': {'color': ALARM, 'fontWeight': 'bold', 'fontSize': 14},
        'data': [[{'name': name, 'xAxis': begin}, {'xAxis': end}] for name, begin, end in spans],
    }


def mark_lines(places: Mapping[str, float], axis: str = 'xAxis') -> Options:
    """Return labelled dotted lines across a figure. `places` has their positions on the axis."""
    return {
        'symbol': 'none',
        'silent': True,
        'animation': False,
        'lineStyle': {'color': '#595959', 'type': 'dotted'},
        'label': {'formatter': '{b}', 'color': '#333333'},
        'data': [{'name': name, axis: place} for name, place in places.items()],
    }


def mark_apart(figure: Options, places: Mapping[str, float]) -> None:
    """Mark positions on the x axis of a figure with labels that do not overlap.

    The server does not know the width of the figure in the browser. Labels that would overlap on a
    phone are therefore stacked.
    """
    axis = figure['xAxis']
    scale = _NARROWEST / ((axis['max'] - axis['min']) or 1.0)
    marks = mark_lines(dict(sorted(places.items(), key=lambda each: each[1])))
    ends = list[float]()  # right end of the last label in each level of the stack, in px
    for mark in marks['data']:
        half = _CHARACTER * (len(mark['name']) + 1) / 2
        at = scale * (mark['xAxis'] - axis['min'])
        free = [level for level, end in enumerate(ends) if end <= at - half]
        level = free[0] if free else len(ends)
        ends[level : level + 1] = [at + half]
        mark['label'] = {'distance': _LABEL_DISTANCE + _LABEL_HEIGHT * level}
    figure['series'][0]['markLine'] = marks
    figure['grid']['top'] += _LABEL_HEIGHT * max(len(ends) - 1, 0)

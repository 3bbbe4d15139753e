# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Views of the control charts, for the means and standard deviations of subgroups of items."""

from typing import ClassVar

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_production.control_chart import SUBGROUP, ControlChart, control_chart
from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.drawing import Drawing
from checkweigher_web.views.view import FigureView

_ROOM = 0.05  # margin above and below the data and limits, as a fraction of their range


class MeansView(FigureView):
    """Control chart of the means of the subgroups in this batch."""

    title = 'Control chart: means'
    label = 'control chart of the means'
    spread: ClassVar[bool] = False

    @classmethod
    def _draw(cls, drawing: Drawing) -> Options:
        series = drawing.lane.series
        chart = control_chart([GRAMS * mass for mass in series.masses])
        return control_figure(chart, series.forgotten, spread=cls.spread)


class SpreadsView(MeansView):
    """Control chart of the standard deviations of the subgroups in this batch."""

    title = 'Control chart: standard deviations'
    label = 'control chart of the standard deviations'
    spread = True


def control_figure(chart: ControlChart | None, forgotten: int, *, spread: bool) -> Options:
    """Return the figure of a control chart with its limits.

    The figure shows the standard deviations of the subgroups with `spread`, otherwise their means.
    A symbol marks each point that breaks a rule, and the legend names the rule. `forgotten` is the
    number of subgroups before those of `chart`.
    """
    if chart is None:
        return charts.nothing(f'needs two subgroups of {SUBGROUP} accepted items of the batch')
    if spread:
        name, unit, values = 's', 'g', chart.std_devs
        limits = {'mean': chart.spread, 'limit': chart.spread_upper}
        rules = np.where(values > chart.spread_upper, 'beyond the limit', '')
    else:
        name, unit, values = 'mean', 'gross, g', chart.means
        limits = {'lower': chart.lower, 'mean': chart.centre, 'upper': chart.upper}
        rules = np.array(chart.marks)
    number = forgotten + np.arange(1, len(values) + 1, dtype=float)
    marks = charts.mark_lines(limits, axis='yAxis')
    series = [
        charts.line(name, number, values, DENOISED, width=2)
        | {'showSymbol': True, 'symbolSize': 5, 'markLine': marks}
    ]
    for rule in sorted({*rules} - {''}):
        broken = rules == rule
        symbols = charts.symbols(rule, number[broken], values[broken], _symbol(rule), 14)
        series.append(symbols | {'symbolRotate': 180 if rule.endswith('falling') else 0})
    figure = charts.figure(series, 'subgroup', unit)
    figure['xAxis'] |= {'minInterval': 1}
    shown = [*values, *limits.values()]
    low, high = min(shown), max(shown)
    room = _ROOM * ((high - low) or 1.0)
    figure['yAxis'] |= {'min': low - room, 'max': high + room}
    figure['yAxis']['axisLabel'] |= {'showMaxLabel': False}
    return figure


def _symbol(rule: str) -> str:
    if rule.startswith('beyond'):
        return 'diamond'
    return 'rect' if rule.endswith('side') else 'triangle'

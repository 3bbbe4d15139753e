# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Views of the control charts of the means and standard deviations of subgroups."""

from typing import ClassVar

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_production.control_chart import SUBGROUP, begun, control_chart
from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.views.view import FigureView, Look

_ROOM = 0.05  # margin above and below the data and limits, as a fraction of their range


class MeansView(FigureView):
    """Control chart of the means of the subgroups in this batch."""

    title = 'Control chart: means'
    label = 'control chart of the means'
    spread: ClassVar[bool] = False

    @classmethod
    def _draw(cls, look: Look) -> Options:
        return control_figure(look.series(), spread=cls.spread)


class SpreadsView(MeansView):
    """Control chart of the standard deviations of the subgroups in this batch."""

    title = 'Control chart: standard deviations'
    label = 'control chart of the standard deviations'
    spread = True


def control_figure(series: MassSeries, *, spread: bool) -> Options:
    """Return the figure of a control chart over time with its limits.

    The figure shows the standard deviations of the subgroups with `spread`, otherwise their means.
    A symbol marks the first subgroup of each run that breaks a rule, and the legend names the rule.
    """
    masses, reference = ([GRAMS * m for m in each] for each in (series.masses, series.reference))
    chart = control_chart(masses, reference)
    if chart is None:
        return charts.nothing(f'needs two subgroups of {SUBGROUP} accepted items of the batch')
    if spread:
        name, unit, values = 's', 'g', chart.std_devs
        limits = {'mean': chart.spread, 'limit': chart.spread_upper}
        rules = np.array(begun(np.where(values > chart.spread_upper, 'beyond the limit', '')))
    else:
        name, unit, values = 'mean', 'gross, g', chart.means
        limits = {'lower': chart.lower, 'mean': chart.centre, 'upper': chart.upper}
        rules = np.array(chart.marks)
    time = charts.local_times(series.stamps[SUBGROUP - 1 :: SUBGROUP])
    marks = charts.mark_lines(limits, axis='yAxis')
    shown = [
        charts.line(name, time, values, DENOISED, width=2)
        | {'showSymbol': True, 'symbolSize': 5, 'markLine': marks}
    ]
    for rule in sorted({*rules} - {''}):
        broken = rules == rule
        symbols = charts.symbols(rule, time[broken], values[broken], _symbol(rule), 14)
        shown.append(symbols | {'symbolRotate': 180 if rule.endswith('falling') else 0})
    figure = charts.figure(shown, '', unit) | {'useUTC': True}
    figure['xAxis'] |= {'type': 'time', 'axisLabel': {'hideOverlap': True}}
    places = [*values, *limits.values()]
    low, high = min(places), max(places)
    room = _ROOM * ((high - low) or 1.0)
    figure['yAxis'] |= {'min': low - room, 'max': high + room}
    figure['yAxis']['axisLabel'] |= {'showMaxLabel': False}
    return figure


def _symbol(rule: str) -> str:
    if rule.startswith('beyond'):
        return 'diamond'
    return 'rect' if rule.endswith('side') else 'triangle'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Views of the control charts of the means and standard deviations of subgroups."""

from typing import ClassVar

import numpy as np

from checkweigher_production.control_chart import SUBGROUP, begun, control_chart
from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.views.view import FigureView, Look

# Margin above and below the data and limits, as a fraction of their range.
_ROOM = 0.05
# Symbols that mark the violations of each rule of the control chart.
_SYMBOLS = {
    Text('beyond the limits'): 'diamond',
    Text('beyond the limit'): 'diamond',
    Text('7 on one side'): 'rect',
    Text('7 rising'): 'triangle',
    Text('7 falling'): 'triangle',
}


class MeansView(FigureView):
    """Control chart of the means of the subgroups in this batch."""

    title = Text('Control chart: means')
    label = Text('control chart of the means')
    spread: ClassVar[bool] = False

    @classmethod
    def _draw(cls, look: Look) -> Options:
        return control_figure(look.series(), look.say, spread=cls.spread)


class SpreadsView(MeansView):
    """Control chart of the standard deviations of the subgroups in this batch."""

    title = Text('Control chart: standard deviations')
    label = Text('control chart of the standard deviations')
    spread = True


def control_figure(series: MassSeries, say: Language = ENGLISH, *, spread: bool) -> Options:
    """Return the figure of a control chart over time with its limits.

    If `spread` is true, the figure shows the standard deviations of the subgroups, otherwise their
    means. A symbol marks the first subgroup of each run that breaks a rule, and the legend names
    the rule. If there are fewer than two subgroups, the figure contains only a text.
    """
    masses, reference = (
        [say.per_kg * mass for mass in each] for each in (series.masses, series.reference)
    )
    chart = control_chart(masses, reference)
    if chart is None:
        text = say('needs two subgroups of {size} accepted items of the batch', size=SUBGROUP)
        return charts.nothing(text)
    if spread:
        name, unit, values = 's', say.unit, chart.std_devs
        limits = {say('mean'): chart.spread, say('limit'): chart.spread_upper}
        rules = np.array(begun(np.where(values > chart.spread_upper, 'beyond the limit', '')))
    else:
        name, unit, values = say('mean'), say('gross, {unit}', unit=say.unit), chart.means
        limits = {say('lower'): chart.lower, say('mean'): chart.centre, say('upper'): chart.upper}
        rules = np.array(chart.marks)
    time = charts.local_times(series.stamps[SUBGROUP - 1 :: SUBGROUP])
    marks = charts.mark_lines(limits, axis='yAxis')
    shown = [
        charts.line(name, time, values, DENOISED, width=2)
        | {'showSymbol': True, 'symbolSize': 5, 'markLine': marks}
    ]
    for rule in sorted({*rules} - {''}):
        broken = rules == rule
        symbols = charts.symbols(say(rule), time[broken], values[broken], _SYMBOLS[rule], 14)
        shown.append(symbols | {'symbolRotate': 180 if rule.endswith('falling') else 0})
    figure = charts.figure(shown, '', unit) | {'useUTC': True}
    figure['xAxis'] |= {'type': 'time', 'axisLabel': {'hideOverlap': True}}
    places = [*values, *limits.values()]
    low, high = min(places), max(places)
    room = _ROOM * ((high - low) or 1.0)
    figure['yAxis'] |= {'min': low - room, 'max': high + room}
    figure['yAxis']['axisLabel'] |= {'showMaxLabel': False}
    return figure

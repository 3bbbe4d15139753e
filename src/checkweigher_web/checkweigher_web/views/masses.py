# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the histogram of the masses."""

import math

import numpy as np

from checkweigher_core.records import GRAMS, Statistics, Verdict
from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.drawing import Drawing
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.views.view import FigureView

_BINS = 25


class MassesView(FigureView):
    """Histogram of the masses in this batch, with the limits."""

    title = 'Masses of the accepted items'
    label = 'histogram of the masses'

    @classmethod
    def _draw(cls, drawing: Drawing) -> Options:
        item, lane = drawing.latest(), drawing.lane
        return histogram(lane.series, None if item is None else item.verdict, lane.statistics)


def histogram(series: MassSeries, latest: Verdict | None, statistics: Statistics | None) -> Options:
    """Return a histogram of masses, with the limits, TU1, TU2 and the nominal mass.

    The limits are those of the `latest` verdict. TU1, TU2 and the nominal mass are shown if the
    statistics are those of the product and batch of the series.
    """
    masses = GRAMS * np.array(series.masses)
    if len(masses) < 2:
        return charts.nothing('needs two accepted items of the batch')
    counts, bounds = np.histogram(masses, bins=min(_BINS, max(5, len(masses) // 4)))
    known: dict[str, float] = {}
    if latest is not None:
        known |= {'lower': latest.lower_limit, 'upper': latest.upper_limit}
    of = series.product, series.batch
    if statistics is not None and (statistics.product, statistics.batch) == of:
        net = {'TU1': statistics.tu1, 'TU2': statistics.tu2, 'nominal': statistics.nominal}
        known |= {name: mass + statistics.tare for name, mass in net.items()}
    limits = {name: GRAMS * mass for name, mass in known.items() if math.isfinite(mass)}
    centres = (bounds[:-1] + bounds[1:]) / 2
    bars: Options = {
        'type': 'bar',
        'name': 'items',
        'barWidth': '95%',
        'itemStyle': {'color': DENOISED},
        'data': np.column_stack([centres, counts]).tolist(),
    }
    figure = charts.figure([bars], 'gross, g', 'items')
    places = [bounds[0], bounds[-1], *limits.values()]
    figure['xAxis'] |= {'min': min(places), 'max': max(places)}
    charts.mark_apart(figure, limits)
    figure['yAxis'] |= {'min': 0, 'minInterval': 1}
    return figure

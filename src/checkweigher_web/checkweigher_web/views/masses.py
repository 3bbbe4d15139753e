# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View with the histogram of the masses of the accepted items."""

import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS, Statistics, Verdict
from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.views.view import FigureView, Look

_BINS = 25
_NARROWEST = 0.01  # minimum total width of the bins in g
_SAME = ' = '  # separator between the names of equal limits
_NOMINAL, _LOWER, _UPPER = Text('nominal'), Text('lower'), Text('upper')


class MassesView(FigureView):
    """Histogram of the accepted masses in this batch, with the limits."""

    title = Text('Masses of the accepted items')
    label = Text('histogram of the masses')

    @classmethod
    def _draw(cls, look: Look) -> Options:
        item = next(iter(look.items()), None)
        latest = None if item is None else item.verdict
        return histogram(look.series(), latest, look.drawing.lane.statistics, look.say)


def histogram(
    series: MassSeries,
    latest: Verdict | None,
    statistics: Statistics | None,
    say: Language = ENGLISH,
) -> Options:
    """Return a histogram of masses, with the limits, TU1, TU2 and the nominal mass.

    The limits are taken from the `latest` verdict. TU1, TU2 and the nominal mass are shown if the
    statistics refer to the product and batch of the series. If the series has fewer than two
    masses, the figure contains only a text.
    """
    masses = GRAMS * np.array(series.masses)
    if len(masses) < 2:
        return charts.nothing(say('needs two accepted items of the batch'))
    scale, known = say.per_kg / GRAMS, limits_of(series.product, series.batch, latest, statistics)
    limits = {limit_name(name, say): scale * mass for name, mass in known.items()}
    counts, bounds = np.histogram(masses, bins=_bounds(masses, latest))
    bounds = scale * bounds
    centres = (bounds[:-1] + bounds[1:]) / 2
    bars: Options = {
        'type': 'bar',
        'name': say('items'),
        'barWidth': '95%',
        'itemStyle': {'color': DENOISED},
        'data': np.column_stack([centres, counts]).tolist(),
    }
    figure = charts.figure([bars], say('gross, {unit}', unit=say.unit), say('items'))
    places = [bounds[0], bounds[-1], *limits.values()]
    figure['xAxis'] |= {'min': min(places), 'max': max(places)}
    charts.mark_apart(figure, limits)
    figure['yAxis'] |= {'min': 0, 'minInterval': 1}
    return figure


def _bounds(masses: NDArray[np.float64], latest: Verdict | None) -> NDArray[np.float64]:
    """Return the bounds of the bins in g.

    Each finite limit of the `latest` verdict is a bound or lies outside all bins, so that no bin
    contains masses on both sides of a limit.
    """
    count = min(_BINS, max(5, len(masses) // 4))
    width = max(float(np.ptp(masses)), _NARROWEST) / count
    own = (latest.lower_limit, latest.upper_limit) if latest else ()
    limits = [GRAMS * limit for limit in own if math.isfinite(limit)]
    origin = limits[0] if limits else float(masses.min())
    if len(limits) > 1 and limits[1] > limits[0]:
        width = (limits[1] - limits[0]) / math.ceil((limits[1] - limits[0]) / width)
    first, last = ((end - origin) / width for end in (masses.min(), masses.max()))
    # Only the last bin of a histogram includes its upper bound. The last bound is therefore above
    # the largest mass, so that a mass at a limit is always in the bin above the limit.
    return origin + width * np.arange(math.floor(first), math.floor(last) + 2)


def limit_name(name: str, say: Language) -> str:
    """Return the translation of a name that `limits_of` returns."""
    return _SAME.join(map(say, name.split(_SAME)))


def limit_label(name: str, mass: float, say: Language) -> str:
    """Return a label with the name of a limit and its mass without unit. `mass` is in g."""
    return f'{limit_name(name, say)} {say.entry(round(say.per_kg * mass / GRAMS, 6))}'


def limits_of(
    product: str, batch: str, latest: Verdict | None, statistics: Statistics | None
) -> dict[str, float]:
    """Return the limits of the gross mass in g by English name, in increasing order.

    The limits are taken from the `latest` verdict. TU1, TU2 and the nominal mass are included if
    the statistics refer to the product and the batch. Limits that are infinite or NaN are left out.
    Equal limits share one entry.
    """
    known: dict[str, float] = {}
    if statistics is not None and (statistics.product, statistics.batch) == (product, batch):
        net = {'TU1': statistics.tu1, 'TU2': statistics.tu2, _NOMINAL: statistics.nominal}
        known |= {name: mass + statistics.tare for name, mass in net.items()}
    if latest is not None:
        known |= {_LOWER: latest.lower_limit, _UPPER: latest.upper_limit}
    found: dict[float, list[str]] = {}
    for name, mass in known.items():
        if math.isfinite(mass):
            found.setdefault(round(GRAMS * mass, 6), []).append(name)
    return {_SAME.join(names): mass for mass, names in sorted(found.items())}

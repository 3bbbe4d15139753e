# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of a batch as one HTML page."""

from collections.abc import Sequence

from matplotlib import rc_context
from matplotlib.figure import Figure
import numpy as np

from checkweigher_core.records import GRAMS, utc
from checkweigher_production.control_chart import SUBGROUP, ControlChart
from checkweigher_validation.batch.batch import Batch
from checkweigher_validation.batch.figures import PartFigures
from checkweigher_validation.report import inline_svg as svg
from checkweigher_validation.report.page import fill

_MOST_LINES = 500  # largest number of rows of a table in the report


@rc_context(fname=svg.STYLE)
def render_batch(batch: Batch, parts: Sequence[PartFigures]) -> str:
    """Return the report of a batch as one HTML page that needs no other file."""
    return fill(
        'batch.html.j2',
        f'Batch {batch.name}',
        ('aid', 'iswd_eksi'),
        batch=batch,
        parts=parts,
        most=_MOST_LINES,
        subgroup=SUBGROUP,
        histogram=_histogram,
        chart=_chart,
        utc=utc,
    )


def _histogram(part: PartFigures) -> Figure:
    figure, axes = svg.new_figure(2.8)
    edges = GRAMS * part.edges
    axes.bar(edges[:-1], part.counts, np.diff(edges), align='edge', color=svg.stand_in(0))
    axes.axvline(GRAMS * part.product.nominal, **svg.DASHED)
    low, high = axes.get_xlim()
    for limit in (part.product.tu1, part.product.tu2):
        if low <= GRAMS * limit <= high:
            axes.axvline(GRAMS * limit, color=svg.MUTED, lw=1.2, ls=(0, (1, 2)))
    axes.set(xlabel='contents, g', ylabel='items')
    return figure


def _chart(chart: ControlChart) -> Figure:
    figure, axes = svg.new_figure(2.8)
    groups = np.arange(1, len(chart.means) + 1)
    axes.plot(groups, GRAMS * chart.means, '.-', color=svg.stand_in(0), lw=0.8, ms=3)
    marked = np.array([bool(mark) for mark in chart.marks])
    axes.plot(groups[marked], GRAMS * chart.means[marked], 'o', color=svg.stand_in(1), ms=4)
    axes.axhline(GRAMS * chart.centre, color=svg.INK, lw=1.0)
    for limit in (chart.lower, chart.upper):
        axes.axhline(GRAMS * limit, **{**svg.DASHED, 'lw': 1.0})
    axes.set(xlabel='subgroup', ylabel='mean, g')
    return figure

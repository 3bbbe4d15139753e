# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The report of a batch as one HTML page."""

from collections.abc import Iterator, Sequence

from matplotlib import rc_context
from matplotlib.figure import Figure
import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_production.control_chart import SUBGROUP, ControlChart
from checkweigher_validation.batch.batch import Batch
from checkweigher_validation.batch.figures import PartFigures
from checkweigher_validation.report.content import number
from checkweigher_validation.report.inline_svg import INK, MUTED, STYLE, stand_in
from checkweigher_validation.report.page import Picture, environment, picture
from checkweigher_validation.report.palette import looks_of

_MOST_LINES = 500  # of a table of changes, stops or corrections


def render_batch(batch: Batch, parts: Sequence[PartFigures]) -> str:
    """Return the report of a batch as one HTML page that needs no other file."""
    with rc_context(STYLE):
        pictures = [list(_pictures(place, part)) for place, part in enumerate(parts)]
    return environment().get_template('batch.html.j2').render(
        batch=batch, parts=list(zip(parts, pictures, strict=True)),
        looks=list(looks_of(('aid', 'iswd_eksi')).values()), grams=_grams, number=number,
        most=_MOST_LINES,
    )  # fmt: skip


def _grams(mass: float) -> str:
    return number(GRAMS * mass, 3)


def _pictures(place: int, part: PartFigures) -> Iterator[Picture]:
    if len(part.masses) > 1:
        yield picture(
            f'histogram-{place}', _histogram(part),
            'Contents of the accepted items. Dashed: nominal weight; dotted: TU1 and TU2.',
        )  # fmt: skip
    if part.chart is not None:
        yield picture(
            f'chart-{place}', _chart(part.chart),
            f'Means of {SUBGROUP} accepted items in the order in which they came, with centre line '
            'and control limits. Marked points break a rule of ISO 7870-2, quoted from memory.',
        )  # fmt: skip


def _histogram(part: PartFigures) -> Figure:
    figure = Figure(figsize=(9.6, 2.8))
    axes = figure.subplots()
    edges = GRAMS * part.edges
    axes.bar(edges[:-1], part.counts, np.diff(edges), align='edge', color=stand_in(0))
    axes.axvline(GRAMS * part.product.nominal, color=INK, lw=1.2, ls=(0, (4, 2)))
    low, high = axes.get_xlim()
    for limit in (part.product.tu1, part.product.tu2):
        if low <= GRAMS * limit <= high:
            axes.axvline(GRAMS * limit, color=MUTED, lw=1.2, ls=(0, (1, 2)))
    axes.set(xlabel='contents, g', ylabel='items')
    return figure


def _chart(chart: ControlChart) -> Figure:
    figure = Figure(figsize=(9.6, 2.8))
    axes = figure.subplots()
    groups = np.arange(1, len(chart.means) + 1)
    axes.plot(groups, GRAMS * chart.means, '.-', color=stand_in(0), lw=0.8, ms=3)
    marked = np.array([bool(mark) for mark in chart.marks])
    axes.plot(groups[marked], GRAMS * chart.means[marked], 'o', color=stand_in(1), ms=4)
    axes.axhline(GRAMS * chart.centre, color=INK, lw=1.0)
    for limit in (chart.lower, chart.upper):
        axes.axhline(GRAMS * limit, color=INK, lw=1.0, ls=(0, (4, 2)))
    axes.set(xlabel='subgroup', ylabel='mean, g')
    return figure

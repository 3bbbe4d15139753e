# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of the overall index A by estimator, mass and speed."""

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.errors import Evaluation, average
from checkweigher_validation.accuracy.paper_table import comparable_index
from checkweigher_validation.accuracy.tables import METRES_PER_MINUTE
from checkweigher_validation.report import inline_svg as svg
from checkweigher_validation.report.content import looks_of

_BOUND: dict[str, Any] = {**svg.DASHED, 'label': '3 × bound'}
_COLUMNS = 3


def index_by_mass_figure(evaluation: Evaluation, part: str) -> Figure:
    """Draw the overall index A by mass, with a panel per speed (figure 11 of Long et al.)."""
    speeds, lines = evaluation.speeds, _lines(evaluation)
    rows = math.ceil((len(speeds) + 1) / _COLUMNS)  # one panel per speed, and one for the legend
    figure, grid = svg.new_figure(2.5 * rows, rows, _COLUMNS, squeeze=False)
    panels = grid.ravel()
    for number, (axes, speed) in enumerate(zip(panels, speeds, strict=False)):
        for name, line in lines.items():
            there = evaluation.select(estimator=name, speed=speed, part=part)
            indices = {GRAMS * one.mass: GRAMS * one.index for one in there}
            axes.plot(*zip(*sorted(indices.items()), strict=True), **line)
        there = evaluation.select(speed=speed, part=part)
        bounds = {GRAMS * one.mass: 3 * GRAMS * one.bound for one in there}
        axes.plot(*zip(*sorted(bounds.items()), strict=True), **_BOUND)
        _logarithmic(axes)
        axes.set_title(f'{METRES_PER_MINUTE * speed:.4g} m/min')
        if number % _COLUMNS == 0:
            axes.set_ylabel('A, g')
        if number + _COLUMNS >= len(speeds):
            axes.set_xlabel('mass, g')
    for axes in panels[len(speeds) :]:
        axes.axis('off')
    handles = [Line2D([], [], **line) for line in (*lines.values(), _BOUND)]
    panels[len(speeds)].legend(handles=handles, loc='center', handlelength=2.6)
    return figure


def averages_figure(evaluation: Evaluation, part: str) -> Figure:
    """Draw averages of the overall index A, by speed and in total (figure 12 of Long et al.)."""
    figure, (left, right) = svg.new_figure(3.9, 1, 2, width_ratios=(1, 1.1))
    _draw_by_speed(left, evaluation, part)
    _draw_overall(right, evaluation, part)
    return figure


def _draw_by_speed(axes: Axes, evaluation: Evaluation, part: str) -> None:
    speeds = evaluation.speeds
    shown = [METRES_PER_MINUTE * speed for speed in speeds]
    for name, line in _lines(evaluation).items():
        groups = [evaluation.select(estimator=name, speed=speed, part=part) for speed in speeds]
        axes.plot(shown, [GRAMS * average(group).index for group in groups], **line)
    groups = [evaluation.select(speed=speed, part=part) for speed in speeds]
    axes.plot(shown, [3 * GRAMS * average(group).bound for group in groups], **_BOUND)
    _logarithmic(axes)
    axes.set(
        xlabel='belt speed, m/min', ylabel='A, g', xticks=shown, title='Average over the masses'
    )


def _draw_overall(axes: Axes, evaluation: Evaluation, part: str) -> None:
    """Draw the average A of each estimator in a row, with the best estimator in the first row."""
    lines, ranked = _lines(evaluation), evaluation.ranked(part)
    papers = {name: GRAMS * comparable_index(evaluation, name) for name in ranked}
    for row, (name, means) in enumerate(ranked.items()):
        mean, color = GRAMS * means.index, lines[name]['color']
        mark: dict[str, Any] = {'marker': lines[name]['marker'], 'ms': 8, 'ls': ''}
        axes.plot(papers[name], row, **mark, mfc=svg.SURFACE, mec=color, mew=1.4, zorder=2)
        axes.plot(mean, row, **mark, mec=svg.SURFACE, mew=0.8, color=color, zorder=3)
        if not math.isnan(mean):
            place = ('axes fraction', 'data')
            axes.annotate(f'{mean:.3f}', (1.01, row), xycoords=place, va='center', fontsize=8.5)
    bound = 3 * GRAMS * average(evaluation.select(part=part)).bound
    if not math.isnan(bound):
        axes.axvline(bound, **svg.DASHED)
    svg.label_rows(axes, [lines[name]['label'] for name in ranked])
    axes.set_xlim(left=0)
    has_paper = not all(map(math.isnan, papers.values()))
    title = 'Average over everything' + (', hollow: the paper' if has_paper else '')
    axes.set(xlabel='A, g', title=title)


def _lines(evaluation: Evaluation) -> dict[str, dict[str, Any]]:
    shared = {'ms': 5.5, 'mec': svg.SURFACE, 'mew': 0.6, 'lw': 1.2}
    return {
        name: {'color': svg.stand_in(number), 'marker': look.marker, 'label': look.label, **shared}
        for number, (name, look) in enumerate(looks_of(evaluation.estimators).items())
    }


def _logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with ticks that suit its range."""
    low, high = axes.dataLim.intervaly
    axes.set_yscale('log')
    steps = (1.0, 2.0, 5.0) if high > 6 * low else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
    axes.yaxis.set_major_locator(LogLocator(subs=steps))
    axes.yaxis.set_major_formatter('{x:g}')
    axes.minorticks_off()
    axes.spines['bottom'].set_color(svg.MUTED)

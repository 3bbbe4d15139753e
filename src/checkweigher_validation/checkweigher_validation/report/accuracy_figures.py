# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of accuracy: A by algorithm, mass and speed, and its averages."""

import math
from typing import Any, cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter
import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.errors import Evaluation, average
from checkweigher_validation.accuracy.paper_table import paper_index
from checkweigher_validation.accuracy.tables import (
    METRES_PER_MINUTE,
    has_paper_masses,
    has_paper_speeds,
)
from checkweigher_validation.report.inline_svg import INK, MUTED, SURFACE, stand_in
from checkweigher_validation.report.palette import Look, looks_of

_BOUND: dict[str, Any] = {'color': INK, 'lw': 1.2, 'ls': (0, (4, 2)), 'label': '3 × bound'}
_COLUMNS = 3


def index_by_mass_figure(evaluation: Evaluation, part: str) -> Figure:
    """Draw A over the mass for each estimator, one panel a speed (figure 11 of the paper)."""
    speeds = evaluation.speeds
    # One place is left for the legend.
    rows = math.ceil((len(speeds) + 1) / _COLUMNS)
    figure = Figure(figsize=(9.6, 2.5 * rows))
    panels = cast(NDArray[np.object_], figure.subplots(rows, _COLUMNS, squeeze=False)).ravel()
    for number, (axes, speed) in enumerate(zip(panels, speeds, strict=False)):
        _draw_speed(axes, evaluation, speed, part)
        axes.set_title(f'{METRES_PER_MINUTE * speed:.4g} m/min')
        if number % _COLUMNS == 0:
            axes.set_ylabel('A, g')
        if number + _COLUMNS >= len(speeds):
            axes.set_xlabel('mass, g')
    for axes in panels[len(speeds) :]:
        axes.axis('off')
    lines = [_line(*entry) for entry in enumerate(looks_of(evaluation.estimators).values())]
    handles = [Line2D([], [], **line) for line in (*lines, _BOUND)]
    panels[len(speeds)].legend(handles=handles, loc='center', handlelength=2.6)
    return figure


def averages_figure(evaluation: Evaluation, part: str) -> Figure:
    """Draw A on average over the masses and over everything (figure 12)."""
    figure = Figure(figsize=(9.6, 3.9))
    left, right = cast(NDArray[np.object_], figure.subplots(1, 2, width_ratios=(1, 1.1)))
    _draw_by_speed(left, evaluation, part)
    _draw_overall(right, evaluation, part)
    return figure


def _draw_speed(axes: Axes, evaluation: Evaluation, speed: float, part: str) -> None:
    for number, (name, look) in enumerate(looks_of(evaluation.estimators).items()):
        there = evaluation.select(estimator=name, speed=speed, part=part)
        there = tuple(sorted(there, key=lambda one: one.mass))
        masses = [GRAMS * one.mass for one in there]
        axes.plot(masses, [GRAMS * one.index for one in there], **_line(number, look))
    bounds = {one.mass: one.bound for one in evaluation.select(speed=speed, part=part)}
    masses = sorted(bounds)
    levels = [3 * GRAMS * bounds[mass] for mass in masses]
    axes.plot([GRAMS * mass for mass in masses], levels, **_BOUND)
    _logarithmic(axes)


def _draw_by_speed(axes: Axes, evaluation: Evaluation, part: str) -> None:
    speeds = evaluation.speeds
    shown = [METRES_PER_MINUTE * speed for speed in speeds]
    for number, (name, look) in enumerate(looks_of(evaluation.estimators).items()):
        groups = [evaluation.select(estimator=name, speed=speed, part=part) for speed in speeds]
        means = [GRAMS * average(group).index for group in groups]
        axes.plot(shown, means, **_line(number, look))
    groups = [evaluation.select(speed=speed, part=part) for speed in speeds]
    axes.plot(shown, [3 * GRAMS * average(group).bound for group in groups], **_BOUND)
    _logarithmic(axes)
    axes.set(
        xlabel='belt speed, m/min', ylabel='A, g', xticks=shown, title='Average over the masses'
    )


def _draw_overall(axes: Axes, evaluation: Evaluation, part: str) -> None:
    """Draw one row for each estimator, the best one on top."""
    looks = looks_of(evaluation.estimators)
    comparable = has_paper_masses(evaluation) and has_paper_speeds(evaluation)
    ranked = evaluation.ranked(part)
    colors = {name: stand_in(number) for number, name in enumerate(looks)}
    paper_shown = False
    for row, (name, means) in enumerate(ranked.items()):
        mean = GRAMS * means.index
        paper = GRAMS * paper_index(name) if comparable else math.nan
        mark: dict[str, Any] = {'marker': looks[name].marker, 'ms': 8, 'ls': ''}
        if not math.isnan(paper):
            axes.plot(paper, row, **mark, mfc=SURFACE, mec=colors[name], mew=1.4, zorder=2)
            paper_shown = True
        axes.plot(mean, row, **mark, mec=SURFACE, mew=0.8, color=colors[name], zorder=3)
        if not math.isnan(mean):
            place = ('axes fraction', 'data')
            axes.annotate(f'{mean:.3f}', (1.01, row), xycoords=place, va='center', fontsize=8.5)
    bound = 3 * GRAMS * average(evaluation.select(part=part)).bound
    if not math.isnan(bound):
        axes.axvline(bound, color=INK, lw=1.2, ls=(0, (4, 2)))
    axes.set_yticks(range(len(ranked)), [looks[name].label for name in ranked])
    axes.tick_params(axis='y', length=0, labelcolor=INK)
    axes.invert_yaxis()
    axes.set_xlim(left=0)
    title = 'Average over everything' + (', hollow: the paper' if paper_shown else '')
    axes.set(xlabel='A, g', title=title)


def _line(number: int, look: Look) -> dict[str, Any]:
    """Return how matplotlib is to draw the curve of an estimator."""
    return {
        'color': stand_in(number), 'marker': look.marker, 'ms': 5.5, 'mec': SURFACE, 'mew': 0.6,
        'lw': 1.2, 'label': look.label,
    }  # fmt: skip


def _logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with plain numbers that suit its range."""
    low, high = axes.dataLim.intervaly
    axes.set_yscale('log')
    if 0 < low < high < math.inf:
        steps = (1.0, 2.0, 5.0) if high > 6 * low else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        ticks = [step * 10.0**decade for decade in decades for step in steps]
        axes.set_ylim(low / 1.08, high * 1.08)
        axes.set_yticks([tick for tick in ticks if low / 1.08 <= tick <= high * 1.08])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which='minor', length=0)
    axes.grid(which='minor', visible=False)
    axes.spines['bottom'].set_color(MUTED)

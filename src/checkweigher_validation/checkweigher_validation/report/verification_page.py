# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of a verification as one HTML page for screen and print."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from checkweigher_validation.report import inline_svg as svg
from checkweigher_validation.report.page import fill
from checkweigher_validation.verification.steps import StepKind

_DRAWN = ('warm-up, passes', 'passes', 'eccentricity', 'repeatability')
_PANELS = 3  # number of panels in a row
_BLUE = svg.stand_in(90)

Values = Mapping[str, Any]


@rc_context(fname=svg.STYLE)
def render_verification(report: Values) -> str:
    """Return the HTML page of a report that `verification.report.report_of` has returned."""
    made = {kind: [step for step in report['steps'] if step['test'] == kind] for kind in StepKind}
    tests = {kind: steps for kind, steps in made.items() if steps}
    drawn = [step for step in report['steps'] if step['test'] in _DRAWN and step['count']]
    figure = _errors_figure(drawn) if drawn else None
    title = f'Verification of {", ".join(map(str, report["machine"].values()))}'
    between = groupby(report['faults_between'], lambda each: (each['after'], each['reasons']))
    faults = [list(same) for _, same in between]  # successive faults of one kind have one row
    return fill(
        'verification.html.j2', title, report=report, tests=tests, figure=figure, faults=faults
    )


def _errors_figure(steps: Sequence[Values]) -> Figure:
    panels: dict[str, list[Values]] = {}
    for step in steps:
        title = f'{step["test"]}, {step["speed_m_per_min"]:g} m/min'
        panels.setdefault(title, []).append(step)
    rows = -(-len(panels) // _PANELS)
    figure, grid = svg.new_figure(0.4 + 2.5 * rows, rows, _PANELS, squeeze=False)
    for axes, (title, own) in zip(grid.flat, panels.items(), strict=False):
        _draw(axes, own)
        axes.set_title(title)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    return figure


def _draw(axes: Axes, steps: Sequence[Values]) -> None:
    for place, step in enumerate(steps):
        errors = [each['error_g'] for each in step['passes'] if each['error_g'] is not None]
        if step['max_error_g'] is not None:
            limit = step['max_error_g']
            axes.fill_between([place - 0.42, place + 0.42], -limit, limit, color=svg.SHADE, lw=0)
        spread = np.linspace(-0.3, 0.3, len(errors)) if len(errors) > 1 else np.zeros(1)
        axes.plot(place + spread, errors, '.', ms=4, color=_BLUE, mec=svg.SURFACE, mew=0.3)
        axes.plot([place - 0.36, place + 0.36], [step['error_g']] * 2, color=svg.INK, lw=1.6)
    axes.set_xticks(range(len(steps)), [_label(step) for step in steps])
    axes.axhline(0, color=svg.INK, lw=0.6)
    axes.set_ylabel('error, g')


def _label(step: Values) -> str:
    more = step['position'] or ''
    if step['minutes_after_first'] is not None:
        more = f'{step["minutes_after_first"]:.0f} min'
    return '\n'.join(filter(None, (f'{step["load_g"]:g} g', more)))

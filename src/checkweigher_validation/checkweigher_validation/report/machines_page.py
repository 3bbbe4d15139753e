# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of the test of estimators on randomly drawn machines as one HTML page."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
import numpy as np

from checkweigher_dsp.estimation.estimators.base import PlotStyle
from checkweigher_validation.accuracy.errors import Evaluation, average
from checkweigher_validation.accuracy.machine_tables import (
    CHOSEN,
    FamilyTable,
    MachineResult,
    choices,
    family_tables,
    ratios,
)
from checkweigher_validation.report import inline_svg as svg
from checkweigher_validation.report.content import looks_of, number
from checkweigher_validation.report.page import fill


@rc_context(fname=svg.STYLE)
def render_machines(
    machines: Sequence[MachineResult], title: str, provenance: Sequence[tuple[str, str]]
) -> str:
    """Return the report on one or more machines as one HTML page that needs no other file."""
    tables = family_tables(machines)
    estimators = tuple(row.estimator for row in tables[0].rows)
    looks = looks_of((*estimators, *(each.chosen for each in machines)))
    shown = ([each.tuned for each in machines], [each.untrained for each in machines])
    return fill(
        'machines.html.j2',
        title,
        estimators,
        provenance=provenance,
        findings=[*_findings(tables, looks), f'{choices(machines).capitalize()}.'],
        tables=[
            (table, _ratios_figure(table, evaluations, looks))
            for table, evaluations in zip(tables, shown, strict=True)
        ],
        machines=[
            (each.machine, looks[each.chosen].label, _by_speed(each.tuned, looks))
            for each in machines
        ],
    )


def _findings(tables: Sequence[FamilyTable], looks: Mapping[str, PlotStyle]) -> Iterator[str]:
    for table in tables:
        rows = [row for row in table.rows if row.estimator != CHOSEN]
        mean, worst, label = min((*row.cells[-1], looks[row.estimator].label) for row in rows)
        yield (
            f'Smallest ratio of A to the attainable A, {table.title}: {label} with '
            f'{number(mean, 2)} on average and {number(worst, 2)} at worst.'
        )


def _by_speed(machine: Evaluation, looks: Mapping[str, PlotStyle]) -> list[tuple[str, list[float]]]:
    """Return the label of each estimator, and A in kg on the test passes at each speed.

    The attainable accuracy counts as an estimator.
    """
    found = []
    for name in machine.estimators:
        at_speeds = [machine.select(estimator=name, speed=at, part='test') for at in machine.speeds]
        label = looks[name].label if name in looks else name
        found.append((label, [average(each).index for each in at_speeds]))
    return found


def _ratios_figure(
    table: FamilyTable, machines: Sequence[Evaluation], looks: Mapping[str, PlotStyle]
) -> Figure:
    figure, axes = svg.new_figure(0.6 + 0.36 * len(table.rows))
    shared: Any = {'ls': '', 'ms': 5, 'mec': svg.SURFACE, 'mew': 0.6, 'alpha': 0.7}
    for place, row in enumerate(table.rows):
        found, marker = ratios(machines, row.estimator), looks[row.estimator].marker
        axes.plot(found, [place] * len(found), marker=marker, color=svg.stand_in(place), **shared)
        axes.plot([np.mean(found)] * 2, [place - 0.3, place + 0.3], color=svg.INK, lw=1.4)
    svg.label_rows(axes, [looks[row.estimator].label for row in table.rows])
    axes.set_xscale('log')
    axes.set_xticks([1, 1.2, 1.5, 2, 3, 5, 10])
    axes.xaxis.set_major_formatter('{x:g}')
    axes.xaxis.set_minor_formatter('')
    axes.axvline(1.0, **svg.DASHED)
    axes.set_xlabel('A / attainable A')
    return figure

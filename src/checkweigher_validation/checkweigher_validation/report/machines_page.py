# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The report of estimators on machines of the family as one HTML page."""

from collections.abc import Mapping, Sequence

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
import numpy as np

from checkweigher_validation.accuracy.errors import Evaluation, average
from checkweigher_validation.accuracy.machine_tables import (
    CHOSEN,
    FamilyTable,
    MachineResult,
    choices,
    family_tables,
    ratios,
)
from checkweigher_validation.accuracy.tables import LEVELS
from checkweigher_validation.report.content import grams, number, speed_label
from checkweigher_validation.report.inline_svg import INK, STYLE, SURFACE, stand_in
from checkweigher_validation.report.page import Picture, environment, picture
from checkweigher_validation.report.palette import Look, looks_of


def render_machines(
    machines: Sequence[MachineResult], title: str, provenance: Sequence[tuple[str, str]]
) -> str:
    """Return the report as one HTML page that needs no other file; at least one machine."""
    tables = family_tables(machines)
    looks = looks_of(tuple(row.estimator for row in tables[0].rows))
    shown = ([each.tuned for each in machines], [each.untrained for each in machines])
    with rc_context(STYLE):
        pictures = [
            _ratios_picture(table, evaluations, looks)
            for table, evaluations in zip(tables, shown, strict=True)
        ]
    return environment().get_template('machines.html.j2').render(
        title=title, provenance=provenance, looks=list(looks.values()),
        findings=[*_findings(tables, looks), f'{choices(machines).capitalize()}.'],
        tables=list(zip(tables, pictures, strict=True)),
        machines=[
            (each.machine, looks[each.chosen].label, _by_speed(each.tuned, looks))
            for each in machines
        ],
        levels=[f'{100 * level:.0f} %' for level in LEVELS],
        speed_label=speed_label, grams=grams, number=number,
    )  # fmt: skip


def _findings(tables: Sequence[FamilyTable], looks: Mapping[str, Look]) -> list[str]:
    """Return a sentence on the best estimator of each table."""
    sentences = []
    for table in tables:
        mean, worst, label = min(
            (*row.cells[-1], looks[row.estimator].label)
            for row in table.rows
            if row.estimator != CHOSEN
        )
        sentences.append(
            f'Smallest A over the attainable A, {table.title}: {label} with {number(mean, 2)} on '
            f'average and {number(worst, 2)} at worst.'
        )
    return sentences


def _by_speed(machine: Evaluation, looks: Mapping[str, Look]) -> list[tuple[str, list[float]]]:
    """Return A in kg at each speed, first what is attainable, then by estimator."""
    return [
        (
            looks[name].label if name in looks else name,
            [
                average(machine.select(estimator=name, speed=speed, part='test')).index
                for speed in machine.speeds
            ],
        )
        for name in machine.estimators
    ]


def _ratios_picture(
    table: FamilyTable, machines: Sequence[Evaluation], looks: Mapping[str, Look]
) -> Picture:
    figure = Figure(figsize=(9.6, 0.6 + 0.36 * len(table.rows)))
    axes = figure.subplots()
    for place, row in enumerate(table.rows):
        found = ratios(machines, row.estimator)
        axes.plot(
            found, np.full(len(found), place), looks[row.estimator].marker, ms=5,
            color=stand_in(place), mec=SURFACE, mew=0.6, alpha=0.7,
        )  # fmt: skip
        axes.plot([np.mean(found)] * 2, [place - 0.3, place + 0.3], color=INK, lw=1.4)
    labels = [looks[row.estimator].label for row in table.rows]
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis='y', length=0, labelcolor=INK)
    axes.invert_yaxis()
    axes.set_xscale('log')
    axes.set_xticks([1, 1.2, 1.5, 2, 3, 5, 10])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.axvline(1.0, color=INK, lw=1.2, ls=(0, (4, 2)))
    axes.set_xlabel('A over the attainable A')
    return picture(
        f'ratios-{table.title}', figure,
        f'A over the attainable A of each machine and speed, {table.title}; the stroke is their '
        'mean. Left of the dashed line an estimator is better than a regression on many more '
        'passes.',
    )  # fmt: skip

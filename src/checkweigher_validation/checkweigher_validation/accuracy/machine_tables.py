# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimators on several machines, held against what is attainable on each: text, CSV and JSON."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
import io
import json
import math

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.classes import AccuracyClass
from checkweigher_validation.accuracy.errors import Evaluation, average, coverage
from checkweigher_validation.accuracy.tables import (
    LEVELS,
    METRES_PER_MINUTE,
    csv_text,
    json_text,
)

# Both stand as estimators in the results of each machine.
ATTAINABLE = 'attainable'
CHOSEN = 'chosen'  # by `tune`, of the tuned ones


@dataclass(frozen=True, slots=True)
class MachineResult:
    """Results on a machine of the family, by the seed that draws it: tuned, and untrained.

    Both have the conditions of `ATTAINABLE` besides, the tuned ones those of `CHOSEN`.
    """

    machine: int
    tuned: Evaluation
    untrained: Evaluation
    chosen: str  # name of the estimator that `tune` chooses on this machine


@dataclass(frozen=True, slots=True)
class FamilyRow:
    """One estimator over all machines; `cells` are of each speed, the last one of all speeds.

    A cell has the mean and the largest of the ratios of A to the attainable A. `trained` is the
    mean of all ratios in training, NaN for what is untrained.
    """

    estimator: str
    cells: tuple[tuple[float, float], ...]
    coverages: tuple[float, ...]  # of the intervals of `LEVELS`
    faults: int
    trained: float


@dataclass(frozen=True, slots=True)
class FamilyTable:
    """Estimators over all machines; the attainable A in kg is a mean over the machines."""

    title: str
    speeds: tuple[float, ...]  # m/s
    attainable: tuple[float, ...]  # of each speed, the last one of all
    rows: tuple[FamilyRow, ...]


def family_tables(machines: Sequence[MachineResult]) -> tuple[FamilyTable, FamilyTable]:
    """Return the tables of the tuned estimators and of the untrained ones, of test passes."""
    return (
        _family_table('tuned', [each.tuned for each in machines]),
        _family_table('untrained', [each.untrained for each in machines]),
    )


def ratios(
    machines: Sequence[Evaluation], estimator: str, speed: float | None = None, part: str = 'test'
) -> list[float]:
    """Return A over the attainable A by machine, and by speed if none in m/s is given."""
    found = []
    for one in machines:
        for at in one.speeds if speed is None else (speed,):
            index = average(one.select(estimator=estimator, speed=at, part=part)).index
            least = average(one.select(estimator=ATTAINABLE, speed=at)).index
            found.append(index / least)
    return found


def _family_table(title: str, machines: Sequence[Evaluation]) -> FamilyTable:
    speeds = machines[0].speeds
    columns = (*speeds, None)
    rows = []
    for name in machines[0].estimators:
        if name == ATTAINABLE:
            continue
        by_column = [ratios(machines, name, speed) for speed in columns]
        there = [each for one in machines for each in one.select(estimator=name, part='test')]
        rows.append(
            FamilyRow(
                name,
                tuple((float(np.mean(each)), float(np.max(each))) for each in by_column),
                tuple(coverage(there, level) for level in LEVELS),
                average(there).faults,
                float(np.mean(ratios(machines, name, part='train'))),
            )
        )
    attainable = [
        [each for one in machines for each in one.select(estimator=ATTAINABLE, speed=speed)]
        for speed in columns
    ]
    means = tuple(average(there).index for there in attainable)
    return FamilyTable(title, speeds, means, tuple(rows))


def family_text(machines: Sequence[MachineResult], title: str) -> str:
    """Return both tables for a terminal."""
    lines = [f'{title}: A over the attainable A, mean over the machines and worst; test passes']
    for table in family_tables(machines):
        speeds = [f'{METRES_PER_MINUTE * speed:.4g} m/min' for speed in table.speeds]
        head = ''.join(f'{name:>14}' for name in (*speeds, 'all'))
        lines.append(
            f'{table.title:<16}{head}' + ''.join(f'{f"in {100 * x:.0f}%":>8}' for x in LEVELS)
            + f'{"faults":>8}' + (f'{"training":>10}' if table.title == 'tuned' else '')
        )  # fmt: skip
        grams = ''.join(f'{GRAMS * value:>14.3f}' for value in table.attainable)
        lines.append(f'{"attainable A, g":<16}{grams}')
        for row in table.rows:
            cells = ''.join(f'{_number(mean):>8}{_number(worst):>6}' for mean, worst in row.cells)
            covered = ''.join(f'{_number(100 * share, 0):>8}' for share in row.coverages)
            trained = '' if math.isnan(row.trained) else f'{row.trained:>10.2f}'
            lines.append(f'{row.estimator:<16}{cells}{covered}{row.faults:>8}{trained}')
    return '\n'.join((*lines, choices(machines)))


def choices(machines: Sequence[MachineResult]) -> str:
    """Return how often `tune` chooses which estimator."""
    counts = Counter(each.chosen for each in machines).most_common()
    return 'tune chooses ' + ', '.join(f'{name} on {count}' for name, count in counts)


def family_csv(
    machines: Sequence[MachineResult], accuracy_class: AccuracyClass = AccuracyClass()
) -> str:
    """Return one row for each machine, estimator, speed, mass and part as CSV.

    The columns are those of `csv_text` after ``machine`` and ``tuned``, 1 or 0. What is attainable
    has rows of its own.
    """
    file = io.StringIO()
    for each in machines:
        for tuned, evaluation in ((1, each.tuned), (0, each.untrained)):
            header, *rows = csv_text(evaluation, accuracy_class).splitlines()
            if not file.tell():
                file.write(f'machine,tuned,{header}\n')
            file.writelines(f'{each.machine},{tuned},{row}\n' for row in rows)
    return file.getvalue()


def family_json(
    machines: Sequence[MachineResult], title: str, provenance: Sequence[tuple[str, str]]
) -> str:
    """Return title, provenance and each condition of each machine with every error as JSON."""
    content = {
        'title': title,
        'provenance': [list(pair) for pair in provenance],
        'machines': [
            {
                'machine': each.machine,
                'tuned': json.loads(json_text(each.tuned))['conditions'],
                'untrained': json.loads(json_text(each.untrained))['conditions'],
            }
            for each in machines
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + '\n'


def _number(value: float, digits: int = 2) -> str:
    return '-' if math.isnan(value) else f'{value:.{digits}f}'

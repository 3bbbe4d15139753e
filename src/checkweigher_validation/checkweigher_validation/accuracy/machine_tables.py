# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of estimators on several machines relative to the attainable accuracy."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import io
import json
import math
from typing import Any

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.classes import AccuracyClass
from checkweigher_validation.accuracy.errors import ConditionResult, Evaluation, average, coverage
from checkweigher_validation.accuracy.tables import (
    LEVELS,
    METRES_PER_MINUTE,
    cell,
    coverage_table,
    csv_text,
    json_conditions,
)

# In the results of a machine, the field `estimator` contains the name of an estimator, ATTAINABLE
# for the attainable accuracy, or CHOSEN for the estimator that the command `tune` chooses.
ATTAINABLE, CHOSEN = 'attainable', 'chosen'


@dataclass(frozen=True, slots=True)
class MachineResult:
    """Results of estimators on a randomly drawn machine."""

    machine: int  # seed of the machine
    tuned: Evaluation  # results of the tuned and the chosen estimators, and attainable accuracy
    untrained: Evaluation  # results with default parameters, and attainable accuracy
    chosen: str  # name of the estimator that the command `tune` chooses


@dataclass(frozen=True, slots=True)
class FamilyRow:
    """Results of one estimator on all machines.

    A ratio is the overall index A of the estimator, divided by A of the attainable accuracy.
    """

    estimator: str
    cells: tuple[tuple[float, float], ...]  # mean and largest ratio at each speed, then overall
    coverages: tuple[float, ...]  # coverage of the intervals at each confidence level in LEVELS
    faults: int  # number of test passes without a mass
    trained: float  # mean ratio on the training passes, NaN without training passes


@dataclass(frozen=True, slots=True)
class FamilyTable:
    """Results of all estimators on all machines."""

    title: str
    speeds: tuple[float, ...]  # m/s
    attainable: tuple[float, ...]  # mean of the attainable A in kg at each speed, then overall
    rows: tuple[FamilyRow, ...]


def family_tables(machines: Sequence[MachineResult]) -> tuple[FamilyTable, FamilyTable]:
    """Return the tables of the tuned estimators and of the untrained estimators on test passes."""
    return (
        _family_table('tuned', [each.tuned for each in machines]),
        _family_table('untrained', [each.untrained for each in machines]),
    )


def ratios(
    machines: Sequence[Evaluation], estimator: str, speed: float | None = None, part: str = 'test'
) -> list[float]:
    """Return the ratio of A of an estimator to the attainable A for each machine.

    Each A is the mean over the masses at the nominal belt speed `speed` in m/s. If `speed` is None,
    there is a ratio for each machine and each speed. The ratio is NaN if the estimator has no
    conditions in the part `part`, or if A is NaN at one of the masses.
    """
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
    names = [name for name in machines[0].estimators if name != ATTAINABLE]
    rows = tuple(_family_row(name, machines, columns) for name in names)
    attainable = tuple(
        average(_conditions(machines, estimator=ATTAINABLE, speed=speed)).index for speed in columns
    )
    return FamilyTable(title, speeds, attainable, rows)


def _family_row(
    name: str, machines: Sequence[Evaluation], columns: Sequence[float | None]
) -> FamilyRow:
    found = [ratios(machines, name, speed) for speed in columns]
    conditions = _conditions(machines, estimator=name, part='test')
    return FamilyRow(
        name,
        cells=tuple((float(np.mean(each)), float(np.max(each))) for each in found),
        coverages=tuple(coverage(conditions, level) for level in LEVELS),
        faults=average(conditions).faults,
        trained=float(np.mean(ratios(machines, name, part='train'))),
    )


def _conditions(machines: Sequence[Evaluation], **chosen: Any) -> list[ConditionResult]:
    """Return the conditions that `Evaluation.select` returns for each machine, in one list."""
    return [one for machine in machines for one in machine.select(**chosen)]


def family_text(machines: Sequence[MachineResult], title: str) -> str:
    """Return the tables of the tuned estimators and of the untrained estimators as text.

    The coverage table of the chosen estimators follows, if `coverage_table` returns one, and then
    the text that `choices` returns.
    """
    lines = [f'{title}: A / attainable A of the test passes, mean and largest of the machines']
    for table in family_tables(machines):
        lines += _table_text(table)
    chosen = _conditions([each.tuned for each in machines], estimator=CHOSEN, part='test')
    lines += coverage_table(chosen, CHOSEN)
    return '\n'.join((*lines, choices(machines)))


def _table_text(table: FamilyTable) -> Iterator[str]:
    speeds = [f'{METRES_PER_MINUTE * speed:.4g} m/min' for speed in table.speeds]
    head = ''.join(f'{name:>14}' for name in (*speeds, 'all'))
    levels = ''.join(f'{f"in {100 * level:.0f}%":>8}' for level in LEVELS)
    training = f'{"training":>10}' if table.title == 'tuned' else ''
    yield f'{table.title:<16}{head}{levels}{"faults":>8}{training}'
    yield f'{"attainable A, g":<16}' + ''.join(f'{GRAMS * x:>14.3f}' for x in table.attainable)
    for row in table.rows:
        cells = ''.join(f'{cell(mean, 2):>8}{cell(worst, 2):>6}' for mean, worst in row.cells)
        covered = ''.join(f'{cell(100 * share, 0):>8}' for share in row.coverages)
        trained = '' if math.isnan(row.trained) else f'{row.trained:>10.2f}'
        yield f'{row.estimator:<16}{cells}{covered}{row.faults:>8}{trained}'


def choices(machines: Sequence[MachineResult]) -> str:
    """Return a text on the number of machines for which `tune` chooses each estimator."""
    counts = Counter(each.chosen for each in machines).most_common()
    return 'tune chooses ' + ', '.join(f'{name} on {count}' for name, count in counts)


def family_csv(
    machines: Sequence[MachineResult], accuracy_class: AccuracyClass = AccuracyClass()
) -> str:
    """Return CSV with a row for each machine, estimator, speed, mass and part.

    The columns are ``machine``, ``tuned`` (1 or 0) and the columns of `csv_text`. The rows
    with the attainable accuracy have ``attainable`` in the column of the estimator.
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
    """Return JSON with title, provenance, and all errors of each condition of each machine."""
    content = {
        'title': title,
        'provenance': provenance,
        'machines': [
            {
                'machine': each.machine,
                'tuned': json_conditions(each.tuned),
                'untrained': json_conditions(each.untrained),
            }
            for each in machines
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + '\n'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of estimators as text table, CSV and JSON."""

from collections.abc import Iterable, Iterator
import json
import math
from typing import Any

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.classes import AccuracyClass, judge
from checkweigher_validation.accuracy.columns import rows_as_csv
from checkweigher_validation.accuracy.errors import (
    ConditionResult,
    Evaluation,
    average,
    coverage,
    distinct,
    same,
)
from checkweigher_validation.accuracy.paper_table import comparable_index, has_paper_masses

METRES_PER_MINUTE = 60.0  # m/min per m/s

LEVELS = (0.68, 0.95)  # confidence levels of the intervals whose coverage is reported.

_MOST_MASSES = 10  # largest number of masses in a coverage table.

# Formats of the CSV columns that do not have six decimal places.
_FORMATS = {
    'belt_speed_m_per_s': '.6g',
    'mass_g': '.6g',
    'std_dev_over_bound': '.4f',
    'coverage_68': '.4f',
    'coverage_95': '.4f',
}


def csv_text(evaluation: Evaluation, accuracy_class: AccuracyClass = AccuracyClass()) -> str:
    """Return CSV with a header and one row for each condition of an evaluation.

    The evaluation must have at least one condition. The cell of an unknown value is empty. The
    columns ``max_mean_error_g`` and ``max_std_dev_g`` contain the limits of the class. In category
    Y, ``max_mean_error_g`` is the limit of each error, and ``max_std_dev_g`` is infinite.
    ``within_class`` is 1 if there are enough weighings and both limits are met.
    """
    rows = []
    for one in _ordered(evaluation):
        judged = judge(one, accuracy_class)
        limits = {'max_mean_error_kg': judged.max_error, 'max_std_dev_kg': judged.max_std_dev}
        rows.append(_csv_row(_values(one) | limits) | {'within_class': int(judged.passed)})
    return ''.join(rows_as_csv([rows[0], *(row.values() for row in rows)]))


def json_text(evaluation: Evaluation) -> str:
    """Return JSON with title, provenance, and all errors of each condition in SI units."""
    content = {
        'title': evaluation.title,
        'provenance': evaluation.provenance,
        'conditions': json_conditions(evaluation),
    }
    return json.dumps(content, indent=1, allow_nan=False) + '\n'


def json_conditions(evaluation: Evaluation) -> list[dict[str, Any]]:
    """Return the statistics and all errors of each condition as plain values, in SI units.

    An unknown value is None.
    """
    return [
        plain_values({**_values(one), 'errors_kg': one.errors, 'stated_std_devs_kg': one.std_devs})
        for one in _ordered(evaluation)
    ]


def text_table(evaluation: Evaluation, accuracy_class: AccuracyClass = AccuracyClass()) -> str:
    """Return a text table of the means over the masses for each estimator and speed.

    The evaluation must have at least one condition. The table covers the test passes or, if there
    are none, the training passes. The columns include the coverage of the stated 68 % and 95 %
    intervals, and the number of conditions within the limits of the class. If the masses are those
    of the paper (Long et al.), a last column shows the overall index A of the paper at each speed
    that the paper has. If there are 2 to 10 masses, a second table shows the coverage by speed and
    mass for the estimator with the smallest A.
    """
    part = evaluation.parts[0]
    lines = [
        f'{evaluation.title}: means over the masses, {part} passes; class {accuracy_class}',
        f'{"m/min":>6}  {"estimator":<14}{"sigma g":>9}{"|mu| g":>9}{"A g":>9}{"/bound":>8}'
        f'{"in 68%":>8}{"in 95%":>8}{"faults":>8}{"class":>8}'
        + (f'{"paper A g":>11}' if has_paper_masses(evaluation) else ''),
    ]
    overall = (None,) if len(evaluation.speeds) > 1 else ()
    for speed in (*evaluation.speeds, *overall):
        lines += _text_block(evaluation, accuracy_class, part, speed)
    best, *_ = evaluation.ranked(part)
    lines += coverage_table(evaluation.select(estimator=best, part=part), best)
    return '\n'.join(lines)


def coverage_table(conditions: Iterable[ConditionResult], title: str) -> list[str]:
    """Return the lines of a table with the coverage of the 95 % intervals in %, by speed and mass.

    Conditions of the same speed and mass are combined. The list is empty for fewer than two masses.
    The list is also empty for more than ten masses, because so many masses have too few passes
    each.
    """
    there = tuple(conditions)
    masses = distinct(one.mass for one in there)
    if not 1 < len(masses) <= _MOST_MASSES:
        return []
    lines = [f'{title}, in 95 % by mass: ' + ''.join(f'{GRAMS * mass:>8.4g}' for mass in masses)]
    for speed in distinct(one.speed for one in there):
        cells = []
        for mass in masses:
            own = [one for one in there if same(one.speed, speed) and same(one.mass, mass)]
            cells.append(f'{cell(100 * coverage(own, LEVELS[-1]), 0):>8}')
        label = f'{METRES_PER_MINUTE * speed:.4g} m/min'
        lines.append(f'{label:>{len(lines[0]) - 8 * len(masses)}}' + ''.join(cells))
    return lines


def cell(value: float, digits: int, unknown: str = '-') -> str:
    """Return a number as text, or `unknown` if it is NaN."""
    return unknown if math.isnan(value) else f'{value:.{digits}f}'


def _ordered(evaluation: Evaluation) -> list[ConditionResult]:
    parts, estimators = evaluation.parts, evaluation.estimators

    def place(one: ConditionResult) -> tuple[int, float, int, float]:
        return parts.index(one.part), one.speed, estimators.index(one.estimator), one.mass

    return sorted(evaluation.conditions, key=place)


def _values(one: ConditionResult) -> dict[str, Any]:
    """Return the statistics of a condition in SI units, by column name."""
    return {
        'part': one.part,
        'estimator': one.estimator,
        'belt_speed_m_per_s': one.speed,
        'mass_kg': one.mass,
        'count': one.count,
        'faults': one.faults,
        'mean_error_kg': one.mean_error,
        'std_dev_kg': one.std_dev,
        'index_kg': one.index,
        'bound_kg': one.bound,
        'std_dev_over_bound': one.ratio,
        **{f'coverage_{100 * level:.0f}': coverage([one], level) for level in LEVELS},
    }


def plain_values(value: Any) -> Any:
    """Convert a value to the types that JSON has.

    Numbers that are not finite become None, and tuples and arrays become lists.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {name: plain_values(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain_values(each) for each in value]
    return plain_values(value.tolist()) if isinstance(value, np.ndarray) else value


def _csv_row(values: dict[str, Any]) -> dict[str, Any]:
    """Return values as the cells of a CSV row, by column name.

    Masses are converted to g. A cell is empty if its value is NaN.
    """
    row = {}
    for key, value in values.items():
        name, shown = key.replace('_kg', '_g'), GRAMS * value if key.endswith('_kg') else value
        if isinstance(shown, float):
            shown = '' if math.isnan(shown) else format(shown, _FORMATS.get(name, '.6f'))
        row[name] = shown
    return row


def _text_block(
    evaluation: Evaluation, accuracy_class: AccuracyClass, part: str, speed: float | None
) -> Iterator[str]:
    label = 'all' if speed is None else f'{METRES_PER_MINUTE * speed:.4g}'
    bound = average(evaluation.select(speed=speed, part=part)).bound
    yield f'{label:>6}  {"bound":<14}{cell(GRAMS * bound, 3):>9}'
    for estimator in evaluation.estimators:
        conditions = evaluation.select(estimator=estimator, speed=speed, part=part)
        if not conditions:
            continue
        means = average(conditions)
        values = (means.std_dev, means.mean_error, means.index)
        covered = (cell(100 * coverage(conditions, level), 0) for level in LEVELS)
        passed = sum(judge(one, accuracy_class).passed for one in conditions)
        paper = comparable_index(evaluation, estimator, speed)
        yield (
            f'{"":>6}  {estimator:<14}'
            + ''.join(f'{cell(GRAMS * value, 3):>9}' for value in values)
            + f'{cell(means.ratio, 2):>8}'
            + ''.join(f'{share:>8}' for share in covered)
            + f'{means.faults:>8}{f"{passed}/{len(conditions)}":>8}'
            + f'{cell(GRAMS * paper, 3, unknown=""):>11}'
        ).rstrip()

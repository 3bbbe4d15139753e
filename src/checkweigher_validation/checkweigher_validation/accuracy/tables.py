# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""An evaluation as a table for a terminal, as CSV and as JSON."""

from collections.abc import Sequence
import csv
import io
import json
import math

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.classes import AccuracyClass, judge
from checkweigher_validation.accuracy.errors import (
    ConditionResult,
    Evaluation,
    average,
    coverage,
    same,
)
from checkweigher_validation.accuracy.paper_table import PAPER_MASSES, PAPER_SPEEDS, paper_index

METRES_PER_MINUTE = 60.0  # in a metre per second

CSV_COLUMNS = (
    'part', 'estimator', 'belt_speed_m_per_s', 'mass_g', 'count', 'faults', 'mean_error_g',
    'std_dev_g', 'index_g', 'bound_g', 'std_dev_over_bound', 'coverage_68', 'coverage_95',
    'max_mean_error_g', 'max_std_dev_g', 'within_class',
)  # fmt: skip

# Of the stated intervals, wherever their coverage is told.
LEVELS = (0.68, 0.95)


def csv_text(evaluation: Evaluation, accuracy_class: AccuracyClass = AccuracyClass()) -> str:
    """Return one row for each condition as CSV, empty where a value is not known.

    Beside it stand the limits of the class, that of the error of each weighing in category Y;
    ``within_class`` is 1 if both are kept by enough weighings.
    """
    file = io.StringIO()
    writer = csv.writer(file, lineterminator='\n')
    writer.writerow(CSV_COLUMNS)
    for one in _ordered(evaluation):
        grams = (one.mean_error, one.std_dev, one.index, one.bound)
        shares = (one.ratio, *(one.coverage(level) for level in LEVELS))
        judged = judge(one, accuracy_class)
        limits = (judged.max_error, judged.max_std_dev)
        writer.writerow(
            [
                one.part, one.estimator, f'{one.speed:.6g}', f'{GRAMS * one.mass:.6g}', one.count,
                one.faults, *(_cell(GRAMS * value, 6) for value in grams),
                *(_cell(value, 4) for value in shares),
                *(_cell(GRAMS * value, 6) for value in limits), int(judged.passed),
            ]
        )  # fmt: skip
    return file.getvalue()


def json_text(evaluation: Evaluation) -> str:
    """Return title, provenance and each condition with every error as JSON, in SI units."""
    content = {
        'title': evaluation.title,
        'provenance': [list(pair) for pair in evaluation.provenance],
        'conditions': [_json_object(one) for one in _ordered(evaluation)],
    }
    return json.dumps(content, indent=1, allow_nan=False) + '\n'


def text_table(evaluation: Evaluation, accuracy_class: AccuracyClass = AccuracyClass()) -> str:
    """Return means over the masses by speed and estimator, then those over all, for a terminal.

    It tells of the test passes if there are any: how often the stated 68 % and 95 % intervals hold,
    and in how many conditions the limits of a class are kept. Beside each stands the paper's A
    where speed and masses are the paper's.
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
    return '\n'.join(lines)


def has_paper_masses(evaluation: Evaluation) -> bool:
    """Whether the masses are those of the paper, so that averages over them can be compared."""
    return _all_same(evaluation.masses, PAPER_MASSES)


def has_paper_speeds(evaluation: Evaluation) -> bool:
    """Whether the speeds are those of the paper."""
    return _all_same(evaluation.speeds, PAPER_SPEEDS)


def _all_same(values: Sequence[float], others: Sequence[float]) -> bool:
    return len(values) == len(others) and all(map(same, values, others))


def _ordered(evaluation: Evaluation) -> list[ConditionResult]:
    parts, estimators = evaluation.parts, evaluation.estimators

    def place(one: ConditionResult) -> tuple[int, float, int, float]:
        return parts.index(one.part), one.speed, estimators.index(one.estimator), one.mass

    return sorted(evaluation.conditions, key=place)


def _json_object(one: ConditionResult) -> dict[str, object]:
    def known(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        'part': one.part,
        'estimator': one.estimator,
        'belt_speed_m_per_s': one.speed,
        'mass_kg': one.mass,
        'count': one.count,
        'faults': one.faults,
        'mean_error_kg': known(one.mean_error),
        'std_dev_kg': known(one.std_dev),
        'index_kg': known(one.index),
        'bound_kg': known(one.bound),
        'std_dev_over_bound': known(one.ratio),
        **{f'coverage_{100 * level:.0f}': known(one.coverage(level)) for level in LEVELS},
        'errors_kg': one.errors.tolist(),
        'stated_std_devs_kg': [known(value) for value in one.std_devs.tolist()],
    }


def _text_block(
    evaluation: Evaluation, accuracy_class: AccuracyClass, part: str, speed: float | None
) -> list[str]:
    """Return the rows of a speed, or of all speeds together."""
    label = 'all' if speed is None else f'{METRES_PER_MINUTE * speed:.4g}'
    bound = average(evaluation.select(speed=speed, part=part)).bound
    rows = [f'{label:>6}  {"bound":<14}{_cell(GRAMS * bound, 3) or "-":>9}']
    comparable = has_paper_masses(evaluation) and (speed or has_paper_speeds(evaluation))
    for estimator in evaluation.estimators:
        there = evaluation.select(estimator=estimator, speed=speed, part=part)
        if there:
            paper = paper_index(estimator, speed) if comparable else math.nan
            rows.append(_text_row(estimator, there, accuracy_class, paper))
    return rows


def _text_row(
    estimator: str, conditions: Sequence[ConditionResult], accuracy_class: AccuracyClass,
    paper: float,
) -> str:  # fmt: skip
    means = average(conditions)
    values = (means.std_dev, means.mean_error, means.index)
    passed = sum(judge(one, accuracy_class).passed for one in conditions)
    covered = (f'{100 * coverage(conditions, level):.0f}' for level in LEVELS)
    row = (
        f'{"":>6}  {estimator:<14}'
        + ''.join(f'{_cell(GRAMS * value, 3) or "-":>9}' for value in values)
        + f'{_cell(means.ratio, 2) or "-":>8}'
        + ''.join(f'{share.replace("nan", "-"):>8}' for share in covered)
        + f'{means.faults:>8}{f"{passed}/{len(conditions)}":>8}{_cell(GRAMS * paper, 3):>11}'
    )
    return row.rstrip()


def _cell(value: float, digits: int) -> str:
    return '' if math.isnan(value) else f'{value:.{digits}f}'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report: numbers as they are shown, and which of them are the best."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.classes import AccuracyClass, Judgement, judge
from checkweigher_validation.accuracy.errors import (
    Average,
    ConditionResult,
    Evaluation,
    average,
    coverage,
)
from checkweigher_validation.accuracy.paper_table import PaperResult, paper_index, paper_result
from checkweigher_validation.accuracy.tables import (
    LEVELS,
    METRES_PER_MINUTE,
    has_paper_masses,
    has_paper_speeds,
)
from checkweigher_validation.report.palette import looks_of

NONE = '–'


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table: a text, a smaller note after it, a state: passed, failed or empty."""

    text: str
    note: str = ''
    best: bool = False
    state: str = ''


@dataclass(frozen=True, slots=True)
class Row:
    """A row: its label, the number of its colour or -1 for none, and its cells."""

    label: str
    series: int
    cells: tuple[Cell, ...]


def number(value: float | None, digits: int = 3, sign: bool = False) -> str:
    """Return a number as it is shown, with a true minus; a dash if it is not known."""
    if value is None or not math.isfinite(value):
        return NONE
    # Adding zero makes minus zero a plain one.
    return f'{round(value, digits) + 0.0:{"+" if sign else ""}.{digits}f}'.replace('-', '−')


def grams(value: float, digits: int = 3) -> str:
    """Return kg as grams."""
    return number(GRAMS * value, digits)


def speed_label(speed: float) -> str:
    """Return m/s as m/min."""
    return f'{METRES_PER_MINUTE * speed:.4g} m/min'


def mass_label(mass: float) -> str:
    """Return kg as grams, in full."""
    return f'{GRAMS * mass:.6g} g'


class Content:
    """Tables and findings of an evaluation with at least one condition, held to a class.

    They are of the part that counts where none is named: 'test' if there are test passes, else
    'train'.
    """

    def __init__(self, evaluation: Evaluation, accuracy_class: AccuracyClass) -> None:
        self._evaluation = evaluation
        self._class = accuracy_class
        self._looks = looks_of(evaluation.estimators)
        self._has_masses = has_paper_masses(evaluation)
        self._has_speeds = has_paper_speeds(evaluation)
        self.part = evaluation.parts[0]
        self._means = evaluation.ranked(self.part)

    @property
    def has_paper(self) -> bool:
        """Whether the paper has a result at these speeds and masses."""
        return any(
            paper_result(one.estimator, one.speed, one.mass) is not None
            for one in self._evaluation.conditions
        )

    @property
    def has_paper_average(self) -> bool:
        """Whether averages over all conditions can be compared with those of the paper."""
        return self._has_masses and self._has_speeds

    def findings(self) -> list[str]:
        """Return the sentences that the report begins with."""
        best, means = next(iter(self._means.items()))
        meeting = [
            look.label
            for name, look in self._looks.items()
            if all(judge(one, self._class).passed for one in self._conditions(estimator=name))
        ]
        who = _enumerate(meeting) if meeting else 'no estimator'
        sentences = [
            _finding_of(self._looks[best].label, means),
            f'Within the limits of {self._class} in all conditions: {who}.',
        ]
        faulty = [
            f'{look.label} {self._means[name].faults}'
            for name, look in self._looks.items()
            if self._means[name].faults
        ]
        if faulty:
            sentences.append(f'Passes that got no mass: {_enumerate(faulty)}.')
        return sentences

    def summary(self) -> list[Row]:
        """Return one row for each estimator, the smallest A first."""
        best = next(iter(self._means.values())).index
        rows = []
        for name, one in self._means.items():
            there = self._conditions(estimator=name)
            passed = sum(judge(condition, self._class).passed for condition in there)
            state = 'passed' if passed == len(there) else 'failed'
            cells = [
                Cell(grams(one.index), best=one.index == best),
                Cell(grams(one.std_dev)),
                Cell(grams(one.mean_error)),
                Cell(number(one.ratio, 2)),
                Cell(f'{passed} of {len(there)}', state=state),
                Cell(str(one.faults), state='failed' if one.faults else ''),
            ]
            if 'train' in self._evaluation.parts and self.part != 'train':
                cells.append(Cell(grams(self._mean(estimator=name, part='train').index)))
            if self.has_paper_average:
                cells.append(Cell(_or_empty(paper_index(name))))
            rows.append(self._row(name, cells))
        return rows

    def by_speed(self) -> list[Row]:
        """Return A, and sigma over its bound, of each estimator at each speed and on average."""
        speeds = (*self._evaluation.speeds, None)
        means = [
            [self._mean(estimator=name, speed=speed) for speed in speeds] for name in self._looks
        ]
        best = np.fmin.reduce([[one.index for one in row] for row in means])
        rows = []
        for name, row in zip(self._looks, means, strict=True):
            cells = (
                Cell(grams(one.index), _times(one.ratio), one.index == least)
                for one, least in zip(row, best, strict=True)
            )
            rows.append(self._row(name, cells))
        bounds = (Cell(grams(3 * self._mean(speed=speed).bound)) for speed in speeds)
        return [*rows, Row('3 × bound of σ', -1, tuple(bounds)), *self._paper_by_speed()]

    def by_condition(self, part: str) -> dict[str, list[Row]]:
        """Return sigma and mu of each condition by speed, those of the paper below ours."""
        groups = {}
        for speed in self._evaluation.speeds:
            at_masses = self._at_masses(speed=speed, part=part)
            bounds = [Cell(grams(there[0].bound) if there else '') for there in at_masses]
            rows = [Row('bound of σ', -1, (*bounds, Cell(''), Cell('')))]
            for name in self._evaluation.estimators:
                if self._conditions(estimator=name, speed=speed, part=part):
                    rows.append(self._condition_row(name, speed, part))
                    rows += self._paper_row(name, speed)
            groups[speed_label(speed)] = rows
        return groups

    def verdicts(self) -> list[Row]:
        """Return one row for each estimator, with one cell for each speed and mass."""
        rows = []
        for name in self._looks:
            cells = (
                _verdict(judge(there[0], self._class)) if there else Cell('')
                for speed in self._evaluation.speeds
                for there in self._at_masses(estimator=name, speed=speed)
            )
            rows.append(self._row(name, cells))
        return rows

    def coverages(self) -> list[Row]:
        """Return how often the stated intervals hold the error: for each part, for each level."""
        rows = []
        for name in self._looks:
            cells = []
            for part in self._evaluation.parts:
                there = self._conditions(estimator=name, part=part)
                cells += [Cell(_percent(coverage(there, level))) for level in LEVELS]
                means = average(there)
                cells += [Cell(str(means.count)), Cell(str(means.faults))]
            rows.append(self._row(name, cells))
        return rows

    def _condition_row(self, name: str, speed: float, part: str) -> Row:
        pairs = [_pair(*there) for there in self._at_masses(estimator=name, speed=speed, part=part)]
        means = self._mean(estimator=name, speed=speed, part=part)
        return self._row(name, [*pairs, Cell(grams(means.index)), Cell(number(means.ratio, 2))])

    def _paper_row(self, name: str, speed: float) -> Iterator[Row]:
        found = [paper_result(name, speed, mass) for mass in self._evaluation.masses]
        if any(found):
            mean = grams(paper_index(name, speed)) if self._has_masses else ''
            cells = (*map(_pair, found), Cell(mean), Cell(''))
            yield Row('the paper', -1, cells)

    def _paper_by_speed(self) -> Iterator[Row]:
        for name, look in self._looks.items() if self._has_masses else ():
            cells = [Cell(_or_empty(paper_index(name, speed))) for speed in self._evaluation.speeds]
            if any(cell.text for cell in cells):
                cells.append(Cell(grams(paper_index(name)) if self._has_speeds else ''))
                yield Row(f'paper: {look.label}', -1, tuple(cells))

    def _conditions(self, **chosen: Any) -> tuple[ConditionResult, ...]:
        """Return the conditions as `Evaluation.select` does; those of `part` by default."""
        return self._evaluation.select(**{'part': self.part, **chosen})

    def _at_masses(self, **chosen: Any) -> list[tuple[ConditionResult, ...]]:
        """Return the conditions at each mass."""
        return [self._conditions(mass=mass, **chosen) for mass in self._evaluation.masses]

    def _mean(self, **chosen: Any) -> Average:
        return average(self._conditions(**chosen))

    def _row(self, name: str, cells: Iterable[Cell]) -> Row:
        return Row(self._looks[name].label, self._evaluation.estimators.index(name), tuple(cells))


def _verdict(judgement: Judgement) -> Cell:
    kept = (judgement.error_passed, judgement.std_dev_passed, judgement.enough_weighings)
    failed = ' '.join(name for name, passed in zip('μσn', kept, strict=True) if not passed)
    return Cell(failed, state='failed') if failed else Cell('✓', state='passed')


def _finding_of(label: str, means: Average) -> str:
    if math.isnan(means.index):
        return 'No estimator has weighed at least two passes in every condition.'
    times = f'; its σ is {number(means.ratio, 2)} times the bound' if means.ratio > 0 else ''
    return f'Smallest A on average: {label} with {grams(means.index)} g{times}.'


def _pair(one: ConditionResult | PaperResult | None = None) -> Cell:
    return Cell(f'{grams(one.std_dev)} / {grams(one.mean_error)}' if one else '')


def _times(ratio: float) -> str:
    return '' if math.isnan(ratio) else f'×{number(ratio, 2)}'


def _percent(share: float) -> str:
    return NONE if math.isnan(share) else f'{number(100 * share, 1)} %'


def _or_empty(mass: float) -> str:
    return '' if math.isnan(mass) else grams(mass)


def _enumerate(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'

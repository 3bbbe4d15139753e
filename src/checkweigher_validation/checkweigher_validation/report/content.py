# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report: the numbers as text, with the best ones marked."""

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
from checkweigher_validation.accuracy.paper_table import (
    PaperResult,
    comparable_index,
    has_paper_conditions,
    paper_result,
)
from checkweigher_validation.accuracy.tables import LEVELS, METRES_PER_MINUTE
from checkweigher_validation.report.palette import looks_of

NONE = '–'


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table."""

    text: str
    note: str = ''  # smaller text after it
    best: bool = False
    state: str = ''  # 'passed', 'failed' or empty


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table."""

    label: str
    series: int  # number of its colour, -1 for none
    cells: tuple[Cell, ...]


def number(value: float | None, digits: int = 3, sign: bool = False, unknown: str = NONE) -> str:
    """Return a number as it is shown, with a true minus; `unknown` if it is not known."""
    if value is None or not math.isfinite(value):
        return unknown
    # Adding zero removes the sign of minus zero.
    return f'{round(value, digits) + 0.0:{"+" if sign else ""}.{digits}f}'.replace('-', '−')


def grams(value: float, digits: int = 3, unknown: str = NONE) -> str:
    """Return a mass in kg as text in g."""
    return number(GRAMS * value, digits, unknown=unknown)


def speed_label(speed: float) -> str:
    """Return a speed in m/s as text in m/min."""
    return f'{METRES_PER_MINUTE * speed:.4g} m/min'


def mass_label(mass: float) -> str:
    """Return a mass in kg as text in g, with all digits."""
    return f'{GRAMS * mass:.6g} g'


class Content:
    """Tables and findings of an evaluation with at least one condition, by the limits of a class.

    They are of the test passes if there are any, otherwise of the training passes, unless a part
    is given.
    """

    def __init__(self, evaluation: Evaluation, accuracy_class: AccuracyClass) -> None:
        self._evaluation = evaluation
        self._class = accuracy_class
        self._looks = looks_of(evaluation.estimators)
        self.part = evaluation.parts[0]
        self._means = evaluation.ranked(self.part)
        self.has_paper_average = has_paper_conditions(evaluation)
        # Whether the paper has a result at one of these speeds and masses.
        self.has_paper = any(
            paper_result(one.estimator, one.speed, one.mass) for one in evaluation.conditions
        )

    def findings(self) -> Iterator[str]:
        """Yield the sentences at the begin of the report."""
        best, means = next(iter(self._means.items()))
        times = f'; its σ is {number(means.ratio, 2)} times the bound' if means.ratio > 0 else ''
        if math.isnan(means.index):
            yield 'No estimator has weighed at least two passes in every condition.'
        else:
            label = self._looks[best].label
            yield f'Smallest A on average: {label} with {grams(means.index)} g{times}.'
        within, faulty = [], []
        for name, look in self._looks.items():
            if all(judge(one, self._class).passed for one in self._conditions(estimator=name)):
                within.append(look.label)
            if faults := self._means[name].faults:
                faulty.append(f'{look.label} {faults}')
        who = _enumerate(within or ['no estimator'])
        yield f'Within the limits of {self._class} in all conditions: {who}.'
        if faulty:
            yield f'Passes that got no mass: {_enumerate(faulty)}.'

    def summary(self) -> Iterator[Row]:
        """Yield one row for each estimator, the smallest A first."""
        best = next(iter(self._means.values())).index
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
                cells.append(Cell(grams(self._paper_index(name), unknown='')))
            yield self._row(name, cells)

    def by_speed(self) -> Iterator[Row]:
        """Yield A, and sigma over its bound, of each estimator at each speed and on average."""
        speeds = (*self._evaluation.speeds, None)
        means = {
            name: [self._mean(estimator=name, speed=speed) for speed in speeds]
            for name in self._looks
        }
        best = np.fmin.reduce([[one.index for one in row] for row in means.values()])
        for name, row in means.items():
            cells = (
                Cell(grams(one.index), _times(one.ratio), one.index == least)
                for one, least in zip(row, best, strict=True)
            )
            yield self._row(name, cells)
        bounds = (Cell(grams(3 * self._mean(speed=speed).bound)) for speed in speeds)
        yield Row('3 × bound of σ', -1, tuple(bounds))
        yield from self._paper_by_speed()

    def _paper_by_speed(self) -> Iterator[Row]:
        for name, look in self._looks.items():
            found = [self._paper_index(name, speed) for speed in self._evaluation.speeds]
            if not all(map(math.isnan, found)):
                found.append(self._paper_index(name))
                cells = (Cell(grams(one, unknown='')) for one in found)
                yield Row(f'paper: {look.label}', -1, tuple(cells))

    def by_condition(self, part: str) -> dict[str, list[Row]]:
        """Return sigma and mu of each condition by speed, those of the paper below ours."""
        return {
            speed_label(speed): list(self._at_speed(speed, part))
            for speed in self._evaluation.speeds
        }

    def _at_speed(self, speed: float, part: str) -> Iterator[Row]:
        at_masses = self._at_masses(speed=speed, part=part)
        bounds = [Cell(grams(there[0].bound) if there else '') for there in at_masses]
        yield Row('bound of σ', -1, (*bounds, Cell(''), Cell('')))
        for name in self._evaluation.estimators:
            chosen = {'estimator': name, 'speed': speed, 'part': part}
            if self._conditions(**chosen):
                means = self._mean(**chosen)
                pairs = [_pair(*there) for there in self._at_masses(**chosen)]
                last = [Cell(grams(means.index)), Cell(number(means.ratio, 2))]
                yield self._row(name, pairs + last)
                yield from self._paper_row(name, speed)

    def verdicts(self) -> Iterator[Row]:
        """Yield one row for each estimator, with one cell for each speed and mass."""
        for name in self._looks:
            cells = (
                _verdict(judge(there[0], self._class)) if there else Cell('')
                for speed in self._evaluation.speeds
                for there in self._at_masses(estimator=name, speed=speed)
            )
            yield self._row(name, cells)

    def coverages(self) -> Iterator[Row]:
        """Yield the coverage of the stated intervals: for each part, for each level."""
        for name in self._looks:
            cells = []
            for part in self._evaluation.parts:
                there = self._conditions(estimator=name, part=part)
                means = average(there)
                cells += [Cell(_percent(coverage(there, level))) for level in LEVELS]
                cells += [Cell(str(means.count)), Cell(str(means.faults))]
            yield self._row(name, cells)

    def _paper_row(self, name: str, speed: float) -> Iterator[Row]:
        found = [paper_result(name, speed, mass) for mass in self._evaluation.masses]
        if any(found):
            mean = grams(self._paper_index(name, speed), unknown='')
            yield Row('the paper', -1, (*map(_pair, found), Cell(mean), Cell('')))

    def _paper_index(self, name: str, speed: float | None = None) -> float:
        return comparable_index(self._evaluation, name, speed)

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


def _pair(one: ConditionResult | PaperResult | None = None) -> Cell:
    return Cell(f'{grams(one.std_dev)} / {grams(one.mean_error)}' if one else '')


def _times(ratio: float) -> str:
    return '' if math.isnan(ratio) else f'×{number(ratio, 2)}'


def _percent(share: float) -> str:
    return NONE if math.isnan(share) else f'{number(100 * share, 1)} %'


def _enumerate(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'

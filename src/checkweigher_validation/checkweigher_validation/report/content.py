# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers and sentences in the report of an evaluation."""

from collections.abc import Iterator, Sequence
from itertools import cycle
import math
from typing import Any

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_dsp.estimation.estimators import METHODS
from checkweigher_dsp.estimation.estimators.base import PlotStyle
from checkweigher_validation.accuracy.classes import AccuracyClass, judge
from checkweigher_validation.accuracy.errors import (
    ConditionResult,
    Evaluation,
    MeanErrors,
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

NONE = '–'

# Label, marker, light colour and dark colour of each estimator. Readers with any kind of colour
# vision can distinguish the colours (after Okabe and Ito).
_LOOKS = {name: each.look for name, each in METHODS.items() if each.look}
_LOOKS['chosen'] = PlotStyle('Chosen by tune', '<', '#7a5230', '#c79a6f')

# Marker, light colour and dark colour of the estimators that are not in `_LOOKS`.
_OTHERS = (('>', '#5f6b1f', '#b5c45a'), ('p', '#6b4fa0', '#b39ae0'))


def looks_of(estimators: tuple[str, ...]) -> dict[str, PlotStyle]:
    """Return the plot styles of estimators by name.

    The label of an unknown estimator is its name.
    """
    others = cycle(_OTHERS)
    return {
        name: _LOOKS[name] if name in _LOOKS else PlotStyle(name, *next(others))
        for name in estimators
    }


def number(value: float | None, digits: int = 3, sign: bool = False, unknown: str = NONE) -> str:
    """Return a number as text with the minus sign U+2212.

    Returns `unknown` if the number is None or not finite. If `sign` is True, a positive number and
    zero have a plus sign.
    """
    if value is None or not math.isfinite(value):
        return unknown
    # Add 0.0, which converts -0.0 to 0.0, because a zero must not be shown with a minus sign.
    return f'{round(value, digits) + 0.0:{"+" if sign else ""}.{digits}f}'.replace('-', '−')


def grams(value: float, digits: int = 3, unknown: str = NONE) -> str:
    """Return a mass in kg as text in g, or `unknown` if it is not finite."""
    return number(GRAMS * value, digits, unknown=unknown)


def speed_label(speed: float) -> str:
    """Return a speed in m/s as text in m/min."""
    return f'{METRES_PER_MINUTE * speed:.4g} m/min'


def mass_label(mass: float) -> str:
    """Return a mass in kg as text in g with up to six significant digits."""
    return f'{GRAMS * mass:.6g} g'


class Content:
    """Numbers and findings of an evaluation, which has at least one condition.

    By default, all numbers are computed from the test passes or, if there are none, from the
    training passes. `accuracy_class` contains the limits. The parameters `chosen` of the methods
    are keywords of `Evaluation.select`.
    """

    def __init__(self, evaluation: Evaluation, accuracy_class: AccuracyClass) -> None:
        self._evaluation = evaluation
        self._class = accuracy_class
        self.looks = looks_of(evaluation.estimators)
        self.part = evaluation.parts[0]
        self.means = evaluation.ranked(self.part)
        self.has_paper_average = has_paper_conditions(evaluation)
        # True if the paper (Long et al.) has a result for one of the conditions.
        self.has_paper = any(
            paper_result(one.estimator, one.speed, one.mass) for one in evaluation.conditions
        )

    def findings(self) -> Iterator[str]:
        """Yield the sentences at the start of the report."""
        best, means = next(iter(self.means.items()))
        times = f'; its σ is {number(means.ratio, 2)} times the bound' if means.ratio > 0 else ''
        if math.isnan(means.index):
            yield 'No estimator has weighed at least two passes in every condition.'
        else:
            label = self.looks[best].label
            yield f'Smallest A on average: {label} with {grams(means.index)} g{times}.'
        within = [look.label for name, look in self.looks.items() if all(self.judged(name))]
        who = _enumerate(within or ['no estimator'])
        yield f'Within the limits of {self._class} in all conditions: {who}.'
        faults = {look.label: self.means[name].faults for name, look in self.looks.items()}
        if faulty := [f'{label} {count}' for label, count in faults.items() if count]:
            yield f'Passes that got no mass: {_enumerate(faulty)}.'

    def conditions(self, **chosen: Any) -> tuple[ConditionResult, ...]:
        """Return the conditions that `Evaluation.select` returns for the keywords `chosen`."""
        return self._evaluation.select(**{'part': self.part, **chosen})

    def at_masses(self, **chosen: Any) -> list[ConditionResult | None]:
        """Return the selected condition at each mass, with None for a mass without a condition."""
        found = (self.conditions(mass=mass, **chosen) for mass in self._evaluation.masses)
        return [there[0] if there else None for there in found]

    def mean(self, **chosen: Any) -> MeanErrors:
        """Return the means over the chosen conditions."""
        return average(self.conditions(**chosen))

    def judged(self, name: str) -> list[bool]:
        """Return whether each condition of an estimator is within the limits of the class.

        A condition with too few weighings is not within the limits.
        """
        return [judge(one, self._class).passed for one in self.conditions(estimator=name)]

    def best_by_speed(self) -> list[float]:
        """Return the smallest mean A in kg of all estimators at each speed, then over all speeds.

        For each estimator, A is averaged over its conditions at the speed or, for the last value,
        over all its conditions. Estimators whose mean is NaN are ignored. The smallest mean is NaN
        if the means of all estimators are NaN.
        """
        speeds = (*self._evaluation.speeds, None)
        rows = [[self.mean(estimator=name, speed=at).index for at in speeds] for name in self.looks]
        return list(np.fmin.reduce(rows))

    def paper_index(self, name: str, speed: float | None = None) -> float:
        """Return A in the paper (Long et al.) in kg, or NaN if the paper has no comparable result.

        The overall index A is averaged over the masses at `speed` in m/s or, if `speed` is None,
        also over the speeds.
        """
        return comparable_index(self._evaluation, name, speed)

    def is_in_paper(self, name: str) -> bool:
        """Return whether the paper has a comparable A of an estimator at one of the speeds."""
        found = (self.paper_index(name, speed) for speed in self._evaluation.speeds)
        return not all(map(math.isnan, found))

    def of_paper(self, name: str, speed: float) -> list[PaperResult | None]:
        """Return the result in the paper at each mass, with None for a mass without a result."""
        return [paper_result(name, speed, mass) for mass in self._evaluation.masses]

    def exceeded(self, condition: ConditionResult) -> str:
        """Return the symbols of the violated limits: μ (error), σ, and n (number of weighings).

        The symbols are separated by spaces. The text is empty if all limits are met.
        """
        found = judge(condition, self._class)
        kept = (found.error_passed, found.std_dev_passed, found.enough_weighings)
        return ' '.join(name for name, passed in zip('μσn', kept, strict=True) if not passed)

    def coverages(self, **chosen: Any) -> list[float]:
        """Return the coverage of the stated intervals in percent at each level in `LEVELS`.

        A coverage is NaN if no pass has a stated standard deviation.
        """
        return [100 * coverage(self.conditions(**chosen), level) for level in LEVELS]


def _enumerate(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'

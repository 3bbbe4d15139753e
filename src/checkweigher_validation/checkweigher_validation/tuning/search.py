# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The search for parameters, the same for every estimator."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import qmc

BUDGET = 240  # evaluations of an estimator on all passes of one speed
_EXPLORED = 0.4  # of the budget
_DESCENTS = 3  # from different places
_APART = 0.25  # in the coordinates of the search, 0 to 1
_FIRST_STEP = 0.2
_SEED = 1
_DIGITS = 5  # significant; more would be noise, and differ from machine to machine

Values = dict[str, float]
Point = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Axis:
    """One parameter of an estimator, and the range to search, both ends included.

    The first value to try may lie outside. On a logarithmic axis factors count rather than
    differences; on a whole one only whole numbers are tried.
    """

    name: str
    low: float
    high: float
    start: float
    logarithmic: bool = False
    whole: bool = False

    def value(self, position: float) -> float:
        """Return the parameter at a position from 0 to 1."""
        position = min(max(position, 0.0), 1.0)
        if self.logarithmic:
            found = self.low * (self.high / self.low) ** position
        else:
            found = self.low + (self.high - self.low) * position
        found = round(found) if self.whole else float(f'{found:.{_DIGITS}g}')
        return min(max(float(found), self.low), self.high)

    @property
    def start_position(self) -> float:
        """Where `start` is, from 0 to 1; where it is outside the end that is nearer."""
        start = min(max(self.start, self.low), self.high)
        if self.logarithmic:
            return math.log(start / self.low) / math.log(self.high / self.low)
        return (start - self.low) / (self.high - self.low)


def search(
    axes: Sequence[Axis], badness: Callable[[Mapping[str, float]], float], budget: int = BUDGET
) -> tuple[Values, float]:
    """Look for the values of the smallest badness.

    Part of the budget is spread evenly over the whole space (Latin hypercube), the start among it.
    From the best of these that lie apart the simplex of Nelder and Mead goes on, and from the best
    end with the rest of the budget.

    Parameters
    ----------
    axes : sequence of Axis
        May be empty: then there is one evaluation.
    badness : callable
        Of values by name; infinite where an estimator fails.
    budget : int
        Evaluations at most, give or take one simplex; 1 leaves the start as it is.

    Returns
    -------
    dict of str to float, float
        The best values that were found, and their badness.
    """
    tried: list[tuple[float, Point, Values]] = []

    def evaluate(position: Point, values: Values) -> float:
        tried.append((badness(values), np.array(position), values))
        return tried[-1][0]

    def at(position: Point) -> float:
        values = {axis.name: axis.value(float(p)) for axis, p in zip(axes, position, strict=True)}
        return evaluate(position, values)

    def descend(origin: Point, step: float, evaluations: int) -> None:
        if evaluations > len(axes) + 1:
            options = {
                'maxfev': evaluations, 'xatol': 1e-3, 'fatol': 1e-9,
                'initial_simplex': _simplex(origin, step),
            }  # fmt: skip
            minimize(at, origin, method='Nelder-Mead', bounds=[(0, 1)] * len(axes), options=options)

    start = np.array([axis.start_position for axis in axes])
    evaluate(start, {axis.name: axis.start for axis in axes})
    if axes and budget > 1:
        spread = qmc.LatinHypercube(len(axes), rng=np.random.default_rng(_SEED))
        for point in spread.random(max(round(budget * _EXPLORED) - 1, 0)):
            at(point)
        origins = _best_apart(tried)
        share = (budget - len(tried)) // (len(origins) + 1)
        for origin in origins:
            descend(origin, _FIRST_STEP, share)
        step = _FIRST_STEP
        while budget - len(tried) > len(axes) + 1:
            step /= 2
            descend(_best(tried)[1], step, budget - len(tried))
    least, _, values = _best(tried)
    return values, least


def _best(tried: Sequence[tuple[float, Point, Values]]) -> tuple[float, Point, Values]:
    return min(tried, key=lambda entry: entry[0])


def _best_apart(tried: Sequence[tuple[float, Point, Values]]) -> list[Point]:
    """Return the best points that lie apart from all better ones."""
    chosen: list[Point] = []
    for _, point, _ in sorted(tried, key=lambda entry: entry[0]):
        if all(np.max(np.abs(point - other)) > _APART for other in chosen):
            chosen.append(point)
        if len(chosen) == _DESCENTS:
            break
    return chosen


def _simplex(origin: Point, step: float) -> Point:
    """Return a simplex with a corner at `origin` that stays between 0 and 1."""
    inward = np.where(origin + step <= 1, step, -step)
    return np.vstack((origin, origin + np.diag(inward)))

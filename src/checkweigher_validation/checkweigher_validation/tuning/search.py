# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search for the best parameters of an estimator."""

from collections.abc import Callable, Mapping, Sequence
import math
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators.base import Axis

BUDGET = 240  # default number of evaluations
_EXPLORED = 0.4  # fraction of the evaluations at points all over the search space
_DESCENTS = 3  # largest number of simplex searches with different start points
_APART = 0.25  # smallest distance between start points of simplex searches, in axis lengths
_FIRST_STEP = 0.2
_SEED = 1
_DIGITS = 5  # significant digits of a value; more digits would differ between computers

Values = dict[str, float]
Point = NDArray[np.float64]
_Trial = tuple[float, Point, Values]


def value_at(axis: Axis, position: float) -> float:
    """Return the value at a position on an axis. Position 0 is `low` and position 1 is `high`.

    A position outside 0..1 is moved to the nearer end. The value is rounded to a whole number if
    the axis requires it, and otherwise to five significant digits.
    """
    position = min(max(position, 0.0), 1.0)
    if axis.logarithmic:
        found = axis.low * (axis.high / axis.low) ** position
    else:
        found = axis.low + (axis.high - axis.low) * position
    found = round(found) if axis.whole else float(f'{found:.{_DIGITS}g}')
    return min(max(float(found), axis.low), axis.high)


def start_position(axis: Axis) -> float:
    """Return the position of the start value on its axis, from 0 to 1.

    A start value outside the axis is moved to the nearer end.
    """
    start = min(max(axis.start, axis.low), axis.high)
    if axis.logarithmic:
        return math.log(start / axis.low) / math.log(axis.high / axis.low)
    return (start - axis.low) / (axis.high - axis.low)


def search(
    axes: Sequence[Axis], badness: Callable[[Mapping[str, float]], float], budget: int = BUDGET
) -> tuple[Values, float]:
    """Search for the values with the smallest badness.

    The search first evaluates the start values and the points of a Latin hypercube. Simplex
    searches (Nelder and Mead) then begin at the best points that are not close to each other. The
    rest of the budget is used for simplex searches from the best point of all.

    Parameters
    ----------
    axes : sequence of Axis
        Parameters to be searched. If there are none, `badness` is evaluated once.
    badness : callable
        Objective as a function of the values by name. It is infinite if the estimator fails.
    budget : int
        Largest number of evaluations. It may be exceeded by the size of a simplex. If it is 1, only
        the start is evaluated.

    Returns
    -------
    dict of str to float, float
        The best values and their badness.
    """
    tried: list[_Trial] = []

    def evaluate(position: Point, values: Values) -> float:
        tried.append((badness(values), position.copy(), values))
        return tried[-1][0]

    def at(position: Point) -> float:
        places = zip(axes, position.tolist(), strict=True)
        return evaluate(position, {axis.name: value_at(axis, place) for axis, place in places})

    start = np.array([start_position(axis) for axis in axes])
    evaluate(start, {axis.name: axis.start for axis in axes})
    if axes and budget > 1:
        _explore(at, tried, len(axes), budget)
    least, _, values = min(tried, key=itemgetter(0))
    return values, least


def _explore(
    at: Callable[[Point], float], tried: Sequence[_Trial], dimensions: int, budget: int
) -> None:
    """Evaluate points until the rest of the budget is too small for a simplex search.

    `at` evaluates a point and adds it to `tried`.
    """
    from scipy.stats import qmc  # imported late, because the import is slow

    points = qmc.LatinHypercube(dimensions, rng=np.random.default_rng(_SEED))
    for point in points.random(max(round(budget * _EXPLORED) - 1, 0)):
        at(point)
    origins = _best_apart(tried)
    share = (budget - len(tried)) // (len(origins) + 1)
    for origin in origins:
        _descend(at, origin, _FIRST_STEP, share)
    step = _FIRST_STEP
    while budget - len(tried) > dimensions + 1:
        step /= 2
        _descend(at, min(tried, key=itemgetter(0))[1], step, budget - len(tried))


def _best_apart(tried: Sequence[_Trial]) -> list[Point]:
    chosen: list[Point] = []
    for _, point, _ in sorted(tried, key=itemgetter(0)):
        if all(np.max(np.abs(point - other)) > _APART for other in chosen):
            chosen.append(point)
    return chosen[:_DESCENTS]


def _descend(at: Callable[[Point], float], origin: Point, step: float, evaluations: int) -> None:
    """Search for the best point by the method of Nelder and Mead, beginning at `origin`.

    `evaluations` is the largest number of evaluations, which a simplex step may exceed. If
    `evaluations` does not exceed the number of corners of a simplex, nothing is evaluated.
    """
    from scipy.optimize import minimize  # imported late, because the import is slow

    if evaluations > len(origin) + 1:
        # All corners of the first simplex must be in the range from 0 to 1.
        inward = np.where(origin + step <= 1, step, -step)
        options: dict[str, Any] = {
            'initial_simplex': np.vstack((origin, origin + np.diag(inward))),
            'maxfev': evaluations,
            'xatol': 1e-3,
            'fatol': 1e-9,
        }
        minimize(at, origin, method='Nelder-Mead', bounds=[(0, 1)] * len(origin), options=options)

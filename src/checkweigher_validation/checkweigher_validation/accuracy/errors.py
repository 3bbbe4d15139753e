# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of estimators: errors of passes whose mass is known, and their statistics.

The figures of merit are from Long et al.: the mean error mu against the true mass, the standard
deviation sigma with n - 1, and the overall index A = |mu| + 3 sigma. (Equation 20 of the paper
subtracts the mean of the readings, which would make every mu zero, but its table does not.)
"""

from collections.abc import Iterable
from dataclasses import dataclass
import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from checkweigher_validation.accuracy.examples import Example

# Speeds and masses that differ by less are equal, because they may have rounding errors.
_SAME = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ConditionResult:
    """All passes of one estimator at one mass and one speed."""

    estimator: str
    speed: float  # m/s, nominal
    mass: float  # kg, true
    part: str  # 'train' if the estimator was tuned on these passes, else 'test'
    errors: NDArray[np.float64]  # (n,), kg: mass less true mass of the passes that were weighed
    std_devs: NDArray[np.float64]  # (n,), kg, as stated; NaN if not stated
    faults: int = 0  # passes that got no mass
    bound: float = math.nan  # kg, the Gauss-Markov bound of sigma; NaN if unknown

    @property
    def count(self) -> int:
        """Passes that were weighed."""
        return len(self.errors)

    @property
    def mean_error(self) -> float:
        """Mean error mu in kg, NaN without a weighed pass."""
        return float(np.mean(self.errors)) if self.count else math.nan

    @property
    def std_dev(self) -> float:
        """Standard deviation sigma in kg, with n - 1; NaN for fewer than two weighed passes."""
        return float(np.std(self.errors, ddof=1)) if self.count > 1 else math.nan

    @property
    def index(self) -> float:
        """Overall index A = |mu| + 3 sigma in kg."""
        return overall_index(self.mean_error, self.std_dev)

    @property
    def ratio(self) -> float:
        """Standard deviation over its Gauss-Markov bound, NaN if the bound is unknown."""
        return self.std_dev / self.bound if self.bound else math.nan


@dataclass(frozen=True, slots=True)
class MeanErrors:
    """Means over conditions, each with the same weight.

    A mean is NaN if one of the conditions has no value, because a condition that could not be
    weighed must not make an estimator look better.
    """

    mean_error: float  # kg, of the magnitudes of mu
    std_dev: float  # kg
    index: float  # kg
    bound: float  # kg
    ratio: float  # of the ratios sigma / bound
    count: int  # total number of passes that were weighed
    faults: int  # total number of passes without a mass


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Result of a protocol: conditions, their provenance, and signals for figures.

    The provenance names all inputs of the protocol with their values: profile, seed, bags,
    versions. No two conditions have the same estimator, speed, mass and part.
    """

    title: str  # one line
    conditions: tuple[ConditionResult, ...]
    provenance: tuple[tuple[str, str], ...]
    examples: tuple[Example, ...] = ()  # signals for the figures

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimators in order of first appearance."""
        return tuple(dict.fromkeys(one.estimator for one in self.conditions))

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that have passes, 'test' first."""
        there = {one.part for one in self.conditions}
        return tuple(part for part in ('test', 'train') if part in there)

    @property
    def speeds(self) -> tuple[float, ...]:
        """Nominal speeds in m/s, ascending."""
        return distinct(one.speed for one in self.conditions)

    @property
    def masses(self) -> tuple[float, ...]:
        """True masses in kg, ascending."""
        return distinct(one.mass for one in self.conditions)

    def select(
        self,
        *,
        estimator: str | None = None,
        speed: float | None = None,
        mass: float | None = None,
        part: str | None = None,
    ) -> tuple[ConditionResult, ...]:
        """Return the conditions with the given values, in their order; speed in m/s, mass in kg."""
        return tuple(
            one
            for one in self.conditions
            if (estimator is None or one.estimator == estimator)
            and (speed is None or same(one.speed, speed))
            and (mass is None or same(one.mass, mass))
            and (part is None or one.part == part)
        )

    def ranked(self, part: str) -> dict[str, MeanErrors]:
        """Return the means of each estimator over its conditions of a part, the smallest A first.

        Estimators without a value of A are last.
        """
        means = {name: average(self.select(estimator=name, part=part)) for name in self.estimators}
        ordered = sorted(means.items(), key=lambda item: np.nan_to_num(item[1].index, nan=math.inf))
        return dict(ordered)


def average(conditions: Iterable[ConditionResult]) -> MeanErrors:
    """Return the means over conditions; without any, they are NaN and the numbers of passes 0."""
    there = tuple(conditions)
    return MeanErrors(
        mean_error=_mean([abs(one.mean_error) for one in there]),
        std_dev=_mean([one.std_dev for one in there]),
        index=_mean([one.index for one in there]),
        bound=_mean([one.bound for one in there]),
        ratio=_mean([one.ratio for one in there]),
        count=sum(one.count for one in there),
        faults=sum(one.faults for one in there),
    )


def coverage(conditions: Iterable[ConditionResult], level: float) -> float:
    """Return the fraction of the stated intervals that contain the error, over all passes.

    `level`, between 0 and 1, is the probability of the interval for a normal distribution. The
    fraction is close to it if the stated standard deviations are right and there is no bias. It is
    NaN if no pass states a standard deviation.
    """
    factor = NormalDist().inv_cdf((1 + level) / 2)
    within = [
        np.abs(one.errors[stated]) <= factor * one.std_devs[stated]
        for one in conditions
        if (stated := np.isfinite(one.std_devs)).any()
    ]
    return float(np.mean(np.concatenate(within))) if within else math.nan


def overall_index(mean_error: float, std_dev: float) -> float:
    """Return A = |mu| + 3 sigma (Long et al., Table 3), in the unit of the two."""
    return abs(mean_error) + 3 * std_dev


def same(one: float, other: float) -> bool:
    """Return whether two nominal speeds in m/s, or two true masses in kg, are equal."""
    return abs(one - other) < _SAME


def distinct(values: Iterable[float]) -> tuple[float, ...]:
    """Return the values in ascending order, without duplicates as defined by `same`."""
    kept: list[float] = []
    for value in sorted(values):
        if not kept or not same(kept[-1], value):
            kept.append(value)
    return tuple(kept)


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else math.nan

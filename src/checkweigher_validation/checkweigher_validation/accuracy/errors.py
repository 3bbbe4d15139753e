# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of the errors of estimators on passes of known mass.

The statistics are those of Long et al.: the mean error mu, the standard deviation sigma of the
errors with n - 1 degrees of freedom, and the overall index ``A = |mu| + 3 sigma``. Equation 20 of
the paper subtracts the mean of the readings from each reading, so that mu would always be zero.
This module and Table 3 of the paper subtract the true mass from each reading.
"""

from collections.abc import Iterable
from dataclasses import dataclass
import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from checkweigher_validation.accuracy.examples import Example

_SAME = 1e-6  # tolerance in m/s or kg for rounding errors of equal speeds and masses


@dataclass(frozen=True, slots=True, eq=False)
class ConditionResult:
    """Errors of one estimator at one condition, which is a true mass and a nominal belt speed."""

    estimator: str
    speed: float  # nominal belt speed in m/s
    mass: float  # true mass in kg
    part: str  # 'train' for the passes on which estimators were tuned, otherwise 'test'
    errors: NDArray[np.float64]  # mass minus true mass of each weighed pass, (n,) in kg
    std_devs: NDArray[np.float64]  # stated standard deviations, (n,) in kg; NaN if not stated
    faults: int = 0  # number of passes without a mass
    bound: float = math.nan  # Gauss-Markov bound of sigma in kg, NaN if it is unknown

    @property
    def count(self) -> int:
        """Number of weighed passes."""
        return len(self.errors)

    @property
    def mean_error(self) -> float:
        """Mean error mu in kg, or NaN if no pass was weighed."""
        return float(np.mean(self.errors)) if self.count else math.nan

    @property
    def std_dev(self) -> float:
        """Standard deviation sigma in kg, or NaN for fewer than two weighed passes."""
        return float(np.std(self.errors, ddof=1)) if self.count > 1 else math.nan

    @property
    def index(self) -> float:
        """Overall index ``A = |mu| + 3 sigma`` in kg, or NaN for fewer than two weighed passes."""
        return overall_index(self.mean_error, self.std_dev)

    @property
    def ratio(self) -> float:
        """Ratio of sigma to its Gauss-Markov bound, NaN if one is unknown or the bound is 0."""
        return self.std_dev / self.bound if self.bound else math.nan


@dataclass(frozen=True, slots=True)
class MeanErrors:
    """Means over conditions, all of which have the same weight.

    A mean is NaN if the value of any condition is NaN, or if there are no conditions. If NaN were
    ignored, an estimator that cannot weigh at a difficult condition would appear better than one
    that can.
    """

    mean_error: float  # mean of the magnitudes of mu in kg
    std_dev: float  # mean of sigma in kg
    index: float  # mean of A in kg
    bound: float  # mean of the Gauss-Markov bound of sigma in kg
    ratio: float  # mean of the ratios of sigma to its bound
    count: int  # total number of weighed passes
    faults: int  # total number of passes without a mass


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Errors of several estimators at several conditions.

    No two conditions have the same estimator, speed, mass and part.
    """

    title: str  # title of the evaluation, in one line
    conditions: tuple[ConditionResult, ...]
    provenance: tuple[tuple[str, str], ...]  # name and value of each input, such as bags and seed
    examples: tuple[Example, ...] = ()  # signals for figures

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimators in the order of their first conditions."""
        return tuple(dict.fromkeys(one.estimator for one in self.conditions))

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that have conditions: 'test', 'train', or both in this order."""
        there = {one.part for one in self.conditions}
        return tuple(part for part in ('test', 'train') if part in there)

    @property
    def speeds(self) -> tuple[float, ...]:
        """Nominal speeds in m/s in ascending order."""
        return distinct(one.speed for one in self.conditions)

    @property
    def masses(self) -> tuple[float, ...]:
        """True masses in kg in ascending order."""
        return distinct(one.mass for one in self.conditions)

    def select(
        self,
        *,
        estimator: str | None = None,
        speed: float | None = None,
        mass: float | None = None,
        part: str | None = None,
    ) -> tuple[ConditionResult, ...]:
        """Return the conditions with the given values. Speed is in m/s, and mass is in kg.

        None selects the conditions with any value.
        """
        return tuple(
            one
            for one in self.conditions
            if (estimator is None or one.estimator == estimator)
            and (speed is None or same(one.speed, speed))
            and (mass is None or same(one.mass, mass))
            and (part is None or one.part == part)
        )

    def ranked(self, part: str) -> dict[str, MeanErrors]:
        """Return the means of each estimator over the conditions of a part, in the order of A.

        Estimators whose A is NaN are last.
        """
        means = {name: average(self.select(estimator=name, part=part)) for name in self.estimators}
        ordered = sorted(means.items(), key=lambda item: np.nan_to_num(item[1].index, nan=math.inf))
        return dict(ordered)


def average(conditions: Iterable[ConditionResult]) -> MeanErrors:
    """Return the means over conditions. If there are no conditions, the means are NaN."""
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
    """Return the fraction of weighed passes whose error is within its confidence interval.

    The interval of a pass is computed from its stated standard deviation for a normal distribution.
    `level` is the confidence level, between 0 and 1. The fraction is close to `level` if the stated
    standard deviations are right and there is no bias. Passes without a stated standard deviation
    are ignored. The fraction is NaN if no pass has a stated standard deviation.
    """
    factor = NormalDist().inv_cdf((1 + level) / 2)
    within = [
        np.abs(one.errors[stated]) <= factor * one.std_devs[stated]
        for one in conditions
        if (stated := np.isfinite(one.std_devs)).any()
    ]
    return float(np.mean(np.concatenate(within))) if within else math.nan


def overall_index(mean_error: float, std_dev: float) -> float:
    """Return the overall index ``A = |mu| + 3 sigma`` (Long et al., Table 3)."""
    return abs(mean_error) + 3 * std_dev


def same(one: float, other: float) -> bool:
    """Return whether two speeds in m/s, or two masses in kg, are equal except for rounding."""
    return abs(one - other) < _SAME


def distinct(values: Iterable[float]) -> tuple[float, ...]:
    """Return the distinct values in ascending order.

    Only the smallest of several values that are equal except for rounding is returned.
    """
    kept: list[float] = []
    for value in sorted(values):
        if not kept or not same(kept[-1], value):
            kept.append(value)
    return tuple(kept)


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else math.nan

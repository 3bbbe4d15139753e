# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gain, offset and uncertainty of an estimator from training passes.

The index by which everything is tuned is that of the paper, A = |mean error| + 3 sigma, averaged
over the masses.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from checkweigher_validation.accuracy.errors import overall_index

# Fewer passes of one mass make no standard deviation worth the name: they are taken together.
_FEWEST_OF_A_MASS = 5
# An offset beside the gain takes passes of different masses, and some to spare.
_FEWEST_FOR_OFFSET = 6
_DISTINCT_MASSES = 1.2  # heaviest over lightest
_FOLDS = 5


@dataclass(frozen=True, slots=True)
class Calibration:
    """``mass = gain * estimate + offset``; `offset` in kg."""

    gain: float
    offset: float

    def apply(self, estimates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return masses in kg."""
        return self.gain * estimates + self.offset


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Variance ``std_dev**2 + (relative * mass)**2``; `std_dev` in kg."""

    std_dev: float
    relative: float


def calibrate(estimates: NDArray[np.float64], masses: NDArray[np.float64]) -> Calibration:
    """Return the gain and offset with the smallest squared errors; (n,), kg, not NaN.

    There is no offset if there are few passes or their masses hardly differ.
    """
    if len(masses) >= _FEWEST_FOR_OFFSET and are_distinct(masses):
        slope, intercept = np.polyfit(estimates, masses, 1)
        return Calibration(float(slope), float(intercept))
    return Calibration(float(estimates @ masses / (estimates @ estimates)), 0.0)


def are_distinct(masses: NDArray[np.float64]) -> bool:
    """Tell whether masses (n,) are far enough apart to show what depends on the mass."""
    return bool(masses.max() > _DISTINCT_MASSES * masses.min())


def index(errors: NDArray[np.float64], masses: NDArray[np.float64]) -> float:
    """Return A in kg, averaged over the masses; those with few passes count together as one."""
    values, counts = np.unique(masses, return_counts=True)
    groups = [errors[masses == value] for value in values[counts >= _FEWEST_OF_A_MASS]]
    rest = errors[np.isin(masses, values[counts < _FEWEST_OF_A_MASS])]
    if len(rest):
        groups.append(rest)
    return float(np.mean([overall_index(group.mean(), _spread(group)) for group in groups]))


def _spread(errors: NDArray[np.float64]) -> float:
    return float(np.std(errors, ddof=1)) if len(errors) > 1 else abs(float(errors[0]))


def calibrated_index(estimates: NDArray[np.float64], masses: NDArray[np.float64]) -> float:
    """Return A in kg after calibration on the same passes, infinite if one has no mass."""
    if not np.all(np.isfinite(estimates)) or np.sum(estimates > 0) < len(estimates):
        return math.inf
    return index(calibrate(estimates, masses).apply(estimates) - masses, masses)


def folds(masses: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return the fold, below `count`, of each pass: (n,) int.

    Every mass that has enough passes is in all folds; those of one mass take turns in time.
    Folds by position alone would each hold a single mass where products come in turn.
    """
    result = np.empty(len(masses), np.intp)
    result[np.argsort(masses, kind='stable')] = np.arange(len(masses)) % min(count, len(masses))
    return result


def held_out_errors(
    estimates: NDArray[np.float64], masses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the errors of passes that took no part in the calibration they are judged by, kg."""
    errors = np.empty(len(masses))
    fold = folds(masses, _FOLDS)
    for number in np.unique(fold):
        out = fold == number
        errors[out] = calibrate(estimates[~out], masses[~out]).apply(estimates[out]) - masses[out]
    return errors


def uncertainty(errors: NDArray[np.float64], masses: NDArray[np.float64]) -> Uncertainty:
    """Return how errors spread, a part in proportion to the mass, by maximum likelihood.

    The errors, (n,) in kg, are of passes that were held out. Few passes know their own scatter
    badly; it is widened so that 95 % intervals hold (Student).
    """
    best, chosen = math.inf, Uncertainty(math.inf, 0.0)
    shape = masses / np.mean(masses)
    for share in np.linspace(0.0, 1.0, 21):  # of the proportional part, at the mean mass
        weights = (1 - share) + share * shape**2
        variance = float(np.mean(errors**2 / weights))
        badness = len(errors) * math.log(max(variance, 1e-300)) + float(np.sum(np.log(weights)))
        if badness < best:
            best = badness
            chosen = Uncertainty(
                math.sqrt(variance * (1 - share)),
                math.sqrt(variance * share) / float(np.mean(masses)),
            )
    widening = float(student.ppf(0.975, len(errors) - 1) / norm.ppf(0.975))
    return Uncertainty(widening * chosen.std_dev, widening * chosen.relative)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gain, offset and uncertainty of an estimator from training passes.

Everything is tuned by the index of the paper, A = |mean error| + 3 sigma, averaged over the masses.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from checkweigher_validation.accuracy.errors import overall_index

# Masses with fewer passes are judged together, because their standard deviation is too uncertain.
_FEWEST_OF_A_MASS = 5
# Passes needed to fit an offset besides the gain.
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

    The offset is 0 if there are few passes or their masses hardly differ.
    """
    if len(masses) >= _FEWEST_FOR_OFFSET and are_distinct(masses):
        slope, intercept = np.polyfit(estimates, masses, 1)
        return Calibration(float(slope), float(intercept))
    return Calibration(float(estimates @ masses / (estimates @ estimates)), 0.0)


def are_distinct(masses: NDArray[np.float64]) -> bool:
    """Return whether masses (n,) differ enough to show an effect of the mass."""
    return bool(masses.max() > _DISTINCT_MASSES * masses.min())


def index(errors: NDArray[np.float64], masses: NDArray[np.float64]) -> float:
    """Return A in kg, averaged over the masses; masses with few passes count as one."""
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

    The passes of one mass are dealt to the folds in turn, so that a mass with enough passes is in
    all folds. Otherwise a fold could hold a single mass.
    """
    result = np.empty(len(masses), np.intp)
    result[np.argsort(masses, kind='stable')] = np.arange(len(masses)) % min(count, len(masses))
    return result


def held_out_errors(
    estimates: NDArray[np.float64], masses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the errors of passes in kg, each by a calibration on other passes."""
    errors = np.empty(len(masses))
    fold = folds(masses, _FOLDS)
    for number in np.unique(fold):
        out = fold == number
        errors[out] = calibrate(estimates[~out], masses[~out]).apply(estimates[out]) - masses[out]
    return errors


def uncertainty(errors: NDArray[np.float64], masses: NDArray[np.float64]) -> Uncertainty:
    """Estimate the spread of errors, in part proportional to the mass, by maximum likelihood.

    The errors, (n,) in kg, are of held-out passes. The spread of few passes is itself uncertain, so
    it is widened until 95 % intervals hold (Student).
    """
    mean = float(np.mean(masses))
    shares = np.linspace(0.0, 1.0, 21)  # of the proportional part, at the mean mass
    weights = 1 - shares[:, np.newaxis] + np.outer(shares, (masses / mean) ** 2)
    variances = np.mean(errors**2 / weights, axis=1)
    badness = np.log(np.maximum(variances, 1e-300)) + np.mean(np.log(weights), axis=1)
    best = int(np.argmin(badness))
    variance, share = float(variances[best]), float(shares[best])
    widening = float(student.ppf(0.975, len(errors) - 1) / norm.ppf(0.975))
    std_dev, relative = math.sqrt(variance * (1 - share)), math.sqrt(variance * share) / mean
    return Uncertainty(widening * std_dev, widening * relative)

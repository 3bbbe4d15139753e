# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gain, offset and uncertainty of an estimator from training passes.

The objective of all tuning is the overall index ``A = |mean error| + 3 sigma`` of Long et al.,
averaged over the masses.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_validation.accuracy.errors import overall_index

# Smallest number of passes of a mass for which A is computed separately. Masses with fewer passes
# are combined, because their separate standard deviations are too uncertain.
_FEWEST_OF_A_MASS = 5
_FEWEST_FOR_OFFSET = 6  # smallest number of passes from which an offset is fitted beside the gain
_DISTINCT_MASSES = 1.2  # masses are distinct above this ratio of the heaviest to the lightest
_FOLDS = 5  # number of folds of `held_out_errors`.
# Rate of the exponential prior for the fraction of the variance that is proportional to mass**2. On
# [0, 1], the mean of this prior is 0.4.
_PRIOR = 1.2


@dataclass(frozen=True, slots=True)
class Calibration:
    """Calibration ``mass = gain * estimate + offset``."""

    gain: float  # dimensionless
    offset: float  # offset in kg

    def apply(self, estimates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the calibrated masses of estimates, in kg."""
        return self.gain * estimates + self.offset


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainty with the variance ``std_dev**2 + (relative * mass)**2``."""

    std_dev: float  # standard deviation in kg of the part that does not depend on the mass
    relative: float  # standard deviation of the part proportional to the mass, divided by the mass


def calibrate(estimates: NDArray[np.float64], masses: NDArray[np.float64]) -> Calibration:
    """Return the calibration with the least sum of squared errors.

    `estimates` and `masses` are in kg, (n,), without NaN. The offset is 0 if there are fewer than
    six passes, or if `are_distinct` returns False for their masses.
    """
    if len(masses) >= _FEWEST_FOR_OFFSET and are_distinct(masses):
        slope, intercept = np.polyfit(estimates, masses, 1)
        return Calibration(float(slope), float(intercept))
    return Calibration(float(estimates @ masses / (estimates @ estimates)), 0.0)


def are_distinct(masses: NDArray[np.float64]) -> bool:
    """Return whether masses, (n,), differ enough to determine how errors depend on the mass.

    The heaviest mass must be more than 1.2 times the lightest.
    """
    return bool(masses.max() > _DISTINCT_MASSES * masses.min())


def index(errors: NDArray[np.float64], masses: NDArray[np.float64]) -> float:
    """Return the index A of `errors` in kg, (n,), averaged over the different `masses`, (n,).

    All masses with fewer than five passes count together as one mass. If the combined mass has only
    one pass, the magnitude of its error replaces the standard deviation.
    """
    values, counts = np.unique(masses, return_counts=True)
    groups = [errors[masses == value] for value in values[counts >= _FEWEST_OF_A_MASS]]
    rest = errors[np.isin(masses, values[counts < _FEWEST_OF_A_MASS])]
    if len(rest):
        groups.append(rest)
    return float(np.mean([overall_index(group.mean(), _spread(group)) for group in groups]))


def _spread(errors: NDArray[np.float64]) -> float:
    return float(np.std(errors, ddof=1)) if len(errors) > 1 else abs(float(errors[0]))


def calibrated_index(estimates: NDArray[np.float64], masses: NDArray[np.float64]) -> float:
    """Return the index A in kg after a calibration on the same passes.

    Returns infinity if the estimate of a pass is not positive or not finite.
    """
    if not np.all(np.isfinite(estimates)) or np.sum(estimates > 0) < len(estimates):
        return math.inf
    return index(calibrate(estimates, masses).apply(estimates) - masses, masses)


def folds(masses: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return the fold of each pass, (n,), a number from 0 to ``count - 1``.

    The passes of each mass are distributed evenly over the folds. If there are fewer passes than
    `count`, each pass is a fold of its own.
    """
    result = np.empty(len(masses), np.intp)
    result[np.argsort(masses, kind='stable')] = np.arange(len(masses)) % min(count, len(masses))
    return result


def held_out_errors(
    estimates: NDArray[np.float64], masses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the errors of passes in kg, (n,), each after a calibration on other passes.

    The passes are divided into five folds, and each fold is calibrated on the other four.
    """
    errors = np.empty(len(masses))
    fold = folds(masses, _FOLDS)
    for number in np.unique(fold):
        out = fold == number
        errors[out] = calibrate(estimates[~out], masses[~out]).apply(estimates[out]) - masses[out]
    return errors


def uncertainty(errors: NDArray[np.float64], masses: NDArray[np.float64]) -> Uncertainty:
    """Estimate the uncertainty of a mass from the errors of held-out passes, (n,) in kg.

    A part of the variance is proportional to mass**2. The share of this part in the variance at the
    mean mass is estimated by its posterior mean, with an exponential prior whose mean is 0.4. The
    variance is then the maximum-likelihood estimate for this share. If all passes have one mass,
    the share is the prior mean, because nothing can be learned about other masses. Beyond the
    masses of the passes, the identifier adds a variance
    (`EstimatorParameters.extrapolation_std_dev`). The uncertainty is multiplied by the ratio of the
    97.5 % quantiles of Student's t and the normal distribution, because the standard deviation of
    few errors is itself uncertain. [own derivation]
    """
    from scipy.stats import norm, t  # imported late, because the import is slow

    mean = float(np.mean(masses))
    shares = np.linspace(0.0, 1.0, 101)  # candidates for the share
    badness = np.array([_badness(share, errors, masses / mean) for share in shares])
    probabilities = np.exp(-len(errors) / 2 * (badness - badness.min()) - _PRIOR * shares)
    share = float(shares @ probabilities / probabilities.sum())
    variance = float(np.mean(errors**2 / _growth(share, masses / mean)))
    widening = float(t.ppf(0.975, len(errors) - 1) / norm.ppf(0.975))
    std_dev, relative = math.sqrt(variance * (1 - share)), math.sqrt(variance * share) / mean
    return Uncertainty(widening * std_dev, widening * relative)


def _growth(share: float, ratios: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance at mass ratios, (n,), relative to the variance at a ratio of 1."""
    return 1 - share + share * ratios**2


def _badness(share: float, errors: NDArray[np.float64], ratios: NDArray[np.float64]) -> float:
    """Return -2 ln(likelihood) per error for the most likely variance, up to a constant."""
    growth = _growth(share, ratios)
    variance = max(float(np.mean(errors**2 / growth)), 1e-300)
    return math.log(variance) + float(np.mean(np.log(growth)))

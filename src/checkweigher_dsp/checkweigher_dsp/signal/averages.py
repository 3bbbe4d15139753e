# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Averages of a signal with vibration, and their uncertainty."""

from functools import lru_cache
import math
from typing import Any

import numpy as np

from checkweigher_dsp.signal import Array

BATCHES = 10  # number of batches in the method of batch means


def batch_mean_std_error(samples: Array) -> float:
    """Return the standard error of the mean of successive samples with coloured noise.

    The method of batch means is used, because successive samples are correlated, whereas the means
    of ten successive batches are nearly independent.

    Parameters
    ----------
    samples : ndarray, (n,) float64
        At least ten successive samples of a constant load.

    Returns
    -------
    float
        Standard error in the unit of `samples`.
    """
    means = [np.mean(batch) for batch in np.array_split(samples, BATCHES)]
    return float(np.std(means, ddof=1) / math.sqrt(BATCHES))


def hann_mean(samples: Array) -> Any:
    """Return the mean of each window, weighted by a Hann window without the zeros at its ends.

    The mean is unbiased for a constant load. An oscillation with two or more periods in the window
    is reduced to less than 3 % at any phase. A plain mean cancels an oscillation only if the window
    contains whole periods.

    Parameters
    ----------
    samples : ndarray, (..., n) float64
        Windows with at least one sample on the last axis.

    Returns
    -------
    ndarray, (...,) float64
        Means in the unit of `samples`, or a float for one window.

    Examples
    --------
    >>> print(hann_mean(np.array([2.0, 4.0, 10.0])).round(6))  # weights 1/4, 1/2, 1/4
    5.0
    """
    weights, total = _hann_weights(samples.shape[-1])
    return np.add.reduce(samples * weights, axis=-1) / total


@lru_cache(maxsize=256)
def _hann_weights(count: int) -> tuple[Array, float]:
    """Return the weights of a Hann window without its zeros, (count,), and their sum."""
    weights: Array = np.hanning(count + 2)[1:-1].astype(np.float64)
    weights.flags.writeable = False
    return weights, float(np.add.reduce(weights))


class RunningMoments:
    """Count, value of largest magnitude, mean and standard deviation of the values added so far.

    Mean and standard deviation are updated by the method of Welford, Technometrics 4 (1962) 419.
    """

    def __init__(self) -> None:
        self.count = 0
        self.largest = 0.0  # signed value of largest magnitude, or 0 if there are no values
        self._mean = self._squares = 0.0  # mean, and sum of squared deviations from it

    def add(self, value: float) -> None:
        """Add a value."""
        self.count += 1
        self.largest = max(self.largest, value, key=abs)
        before = value - self._mean
        self._mean += before / self.count
        self._squares += before * (value - self._mean)

    @property
    def mean(self) -> float:
        """Mean of the added values, or NaN without values."""
        return self._mean if self.count else math.nan

    @property
    def std_dev(self) -> float:
        """Standard deviation of the added values, or NaN for fewer than two values."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan

"""The reading of the empty belt, followed from product to product."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.averaging import hann_mean

# An average over less than this is not free of the vibration of the belt.
_SHORTEST_AVERAGE = 0.1  # s
# Least variance of a reading, as a share of the initial one: a signal without noise must not stop
# the filter. Not in counts, so that the gain of the load cell does not matter.
_LEAST_NOISE = 1e-8
_JUMP = 4.0  # standard deviations
_MEMORY = 0.95  # weight of the scatter seen so far at each further stretch


@dataclass(frozen=True, slots=True)
class Zero:
    """Reading of the empty belt and its standard deviation, counts."""

    counts: float
    std_dev: float


class ZeroTracker:
    """Follow the zero of a load cell as a random walk, by a scalar Kalman filter.

    Each empty stretch of belt is one measurement, its Hann-weighted mean. Its variance follows
    from how far the means of the two halves of a stretch are apart, pooled over the stretches seen
    so far: that holds whatever mixture of lines and noise shakes the belt. Averaging goes on from
    product to product, so that the moments between dense products are enough.

    Parameters
    ----------
    initial, initial_std_dev : float
        Zero at calibration and how far it may have drifted since, counts.
    random_walk : float
        Drift, counts per square root of a second.
    sample_rate : float
        Hz.

    References
    ----------
    R. E. Kalman, A new approach to linear filtering and prediction problems, J. Basic Eng. 82
    (1960) 35-45; the local-level case.
    """

    def __init__(
        self, initial: float, initial_std_dev: float, random_walk: float, sample_rate: float
    ) -> None:
        self._value = initial
        self._initial_variance = initial_std_dev**2
        self._variance = self._initial_variance
        self._walk_variance = random_walk**2
        self._sample_rate = sample_rate
        self._stamp: float | None = None
        self._scatter = 0.0  # sum of the variances that the halves of the stretches give
        self._degrees = 0.0  # number of these

    def update(self, time: float, counts: NDArray[np.int32]) -> Zero:
        """Take the samples of one empty stretch and return the zero after them.

        Parameters
        ----------
        time : float
            s, end of the stretch.
        counts : ndarray, (n,) int32
            The samples; with fewer than two the zero is only carried on.
        """
        if self._stamp is not None:
            self._variance += self._walk_variance * max(time - self._stamp, 0.0)
            self._variance = min(self._variance, self._initial_variance)
        self._stamp = time
        if len(counts) >= 2:
            reading, noise = self._measure(counts.astype(np.float64))
            innovation = reading - self._value
            if innovation**2 > _JUMP**2 * (self._variance + noise):
                # Something has settled on the belt, or was wiped off it: start afresh.
                self._variance = self._initial_variance
            gain = self._variance / (self._variance + noise)
            self._value += gain * innovation
            self._variance *= 1 - gain
        return self.zero

    def _measure(self, counts: NDArray[np.float64]) -> tuple[float, float]:
        """Return the reading of a stretch and its variance, counts and counts^2."""
        least = _LEAST_NOISE * self._initial_variance
        if len(counts) < _SHORTEST_AVERAGE * self._sample_rate:
            return float(np.mean(counts)), float(np.var(counts)) + least
        half = len(counts) // 2
        difference = hann_mean(counts[:half]) - hann_mean(counts[-half:])
        # The mean of two halves, each of variance difference^2 / 2.
        self._scatter = _MEMORY * self._scatter + difference**2 / 4
        self._degrees = _MEMORY * self._degrees + 1
        return hann_mean(counts), self._scatter / self._degrees + least

    @property
    def zero(self) -> Zero:
        """The zero as it stands."""
        return Zero(self._value, math.sqrt(self._variance))

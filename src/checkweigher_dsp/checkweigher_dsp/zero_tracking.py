"""The reading of the empty belt, followed from product to product."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

# Vibration of the belt is correlated over some tens of milliseconds: samples closer than this
# do not count as independent readings of the zero.
_CORRELATION_TIME = 1 / 30  # s
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

    Each empty stretch of belt is one measurement. Its variance follows from the scatter of the
    means of short batches of samples, pooled over the stretches seen so far, so that a long quiet
    stretch weighs more than the moments between dense products, and averaging goes on from
    product to product.

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
        self._scatter = 0.0  # of batch means about their own mean, sum of squares
        self._degrees = 0.0  # of freedom in it

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
            noise = self._noise_of_mean(counts)
            innovation = float(np.mean(counts)) - self._value
            if innovation**2 > _JUMP**2 * (self._variance + noise):
                # Something has settled on the belt, or was wiped off it: start afresh.
                self._variance = self._initial_variance
            gain = self._variance / (self._variance + noise)
            self._value += gain * innovation
            self._variance *= 1 - gain
        return self.zero

    def _noise_of_mean(self, counts: NDArray[np.int32]) -> float:
        """Return the variance of the mean of a stretch, counts^2."""
        size = max(1, round(_CORRELATION_TIME * self._sample_rate))
        batches = len(counts) // size
        if batches >= 2:
            means = counts[: batches * size].reshape(batches, size).mean(axis=1)
            self._scatter = _MEMORY * self._scatter + float(np.var(means)) * batches
            self._degrees = _MEMORY * self._degrees + batches - 1
        if batches < 1 or self._degrees == 0:
            return float(np.var(counts)) + _LEAST_NOISE * self._initial_variance
        return self._scatter / self._degrees / batches + _LEAST_NOISE * self._initial_variance

    @property
    def zero(self) -> Zero:
        """The zero as it stands."""
        return Zero(self._value, math.sqrt(self._variance))

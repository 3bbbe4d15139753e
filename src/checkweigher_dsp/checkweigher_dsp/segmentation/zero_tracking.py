# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tracking of the zero, which is the reading of the empty belt, from product to product."""

from dataclasses import dataclass
import math
from statistics import median

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import BATCHES, batch_mean_std_error, hann_mean

# Shortest duration in s of a Hann-weighted mean, above the periods of belt vibration.
_SHORTEST_AVERAGE = 0.1
# Least variance of a reading as a fraction of the initial variance. Without this limit, the filter
# would no longer follow the zero after a signal without noise.
_LEAST_NOISE = 1e-8
# Smallest change of the zero that counts as a jump, in standard deviations.
_JUMP = 4.0
# A part of a segment is an outlier if its distance from the median of the parts exceeds `_OUTLYING`
# times the median distance plus `_LEAST_OUTLYING` times the initial standard deviation.
_OUTLYING, _LEAST_OUTLYING = 30.0, 0.02
_PART = 0.05  # duration of a part in s
_FEWEST_PARTS = 5  # minimum number of parts for the detection of outliers
_MEMORY = 0.95  # factor by which the weight of older variances decreases with each segment.
# Factor by which the weight of older likelihoods decreases with each reading.
_EVIDENCE_MEMORY = 0.98
_DRIFT_TIME = 600.0  # correlation time of a thermal drift in s


@dataclass(frozen=True, slots=True)
class Zero:
    """Zero and its standard deviation in counts, and whether it is `trusted` for weighing."""

    counts: float
    std_dev: float
    trusted: bool = True


@dataclass(frozen=True, slots=True)
class ZeroLimits:
    """Limits of zero tracking."""

    range: float = math.inf  # largest distance from the zero of calibration in counts
    rate: float = math.inf  # maximum rate of change in counts/s.
    # Largest difference in counts between the means of the parts of a stable segment.
    stability: float = math.inf


class _Motion:
    """Kalman filter for a zero with a random walk and a drift.

    The drift is an Ornstein-Uhlenbeck process with the variance `drifts`. `initial_variance` is the
    variance of the initial zero, and `walk_variance` the variance of the random walk after 1 s. The
    units are counts and s.
    """

    def __init__(
        self, value: float, initial_variance: float, walk_variance: float, drifts: float
    ) -> None:
        self.value = value
        self._initial_variance = initial_variance
        self._walk_variance = walk_variance
        self._drifts = drifts
        self.begin()

    def begin(self) -> None:
        """Reset the variance, the drift and the evidence, but keep the zero."""
        self.variance = self._initial_variance
        self._drift, self._drift_variance = 0.0, self._drifts
        self._covariance = 0.0  # covariance of zero and drift
        self.evidence = 0.0  # weighted log-likelihood of the readings since the reset

    def set(self, value: float, variance: float) -> None:
        """Set the zero and its variance, and keep the drift."""
        self.value, self.variance, self._covariance = value, variance, 0.0

    def carry_on(self, elapsed: float) -> None:
        """Predict the zero and the drift after the time `elapsed` in s.

        The variance of the zero is limited to the initial variance.
        """
        left = math.exp(-elapsed / _DRIFT_TIME)
        reach = _DRIFT_TIME * (1 - left)
        self.value += reach * self._drift
        self._drift *= left
        changed = 2 * elapsed / _DRIFT_TIME - (1 - left) * (3 - left)
        self.variance += (
            self._walk_variance * elapsed
            + 2 * reach * self._covariance
            + reach**2 * self._drift_variance
            + _DRIFT_TIME**2 * changed * self._drifts
        )
        self._covariance = left * (self._covariance + reach * self._drift_variance)
        self._covariance += reach * (1 - left) * self._drifts
        self._drift_variance = left**2 * self._drift_variance + (1 - left**2) * self._drifts
        if self.variance > self._initial_variance:
            self._covariance *= math.sqrt(self._initial_variance / self.variance)
            self.variance = self._initial_variance

    def correct(self, reading: float, noise: float, allowed: tuple[float, float]) -> float:
        """Correct zero and drift by a reading with the variance `noise`.

        Returns the variance of the corrected zero. The zero is limited to the `allowed` range. At a
        limit, the drift and the variance of the filter are not changed.
        """
        innovation, variance = reading - self.value, self.variance + noise
        # The constant term of the log-likelihood is omitted, because only differences matter.
        likelihood = -0.5 * (innovation**2 / variance + math.log(variance))
        self.evidence = _EVIDENCE_MEMORY * self.evidence + likelihood
        gain, drift_gain = self.variance / variance, self._covariance / variance
        corrected, left = self.value + gain * innovation, self.variance * (1 - gain)
        self.value = _within(corrected, allowed)
        if self.value == corrected:
            self._drift += drift_gain * innovation
            self._drift_variance -= drift_gain * self._covariance
            self._covariance *= 1 - gain
            self.variance = left
        return left


class ZeroTracker:
    """Tracking of the zero of a load cell by two Kalman filters, without and with a drift.

    The filter without a drift lags behind a drifting zero. The filter with a drift estimates a
    constant zero with a larger variance than the other filter. So the results of both filters are
    averaged, weighted by the likelihood of the readings.

    Each segment of the empty belt gives one reading, which is its Hann-weighted mean. The variance
    of the readings is estimated from the differences between the halves of many segments, so that
    it is valid for any mixture of vibration and noise. The reading of a segment shorter than 0.1 s
    is its plain mean, with the variance of its samples. The filters average many readings.

    An unseen object may be on the belt. So after the first reading, a reading that a drift does not
    explain is accepted only if the reading of a second segment confirms it.

    Parameters
    ----------
    initial, initial_std_dev : float
        Zero of calibration, and standard deviation of its change since calibration, in counts.
    random_walk : float
        Standard deviation of the random walk in counts/sqrt(s).
    sample_rate : float
        Sample rate in Hz.
    limits : ZeroLimits
        Limits of zero tracking according to OIML R 51.
    drift : float
        Standard deviation of the drift in counts/s. With 0, the filter with a drift is not used.

    References
    ----------
    R. E. Kalman, A new approach to linear filtering and prediction problems, J. Basic Eng. 82
    (1960) 35-45: the local level and the local linear trend. D. T. Magill, Optimal adaptive
    estimation of sampled stochastic processes, IEEE Trans. Automatic Control 10 (1965) 434-439.
    """

    def __init__(
        self,
        initial: float,
        initial_std_dev: float,
        random_walk: float,
        sample_rate: float,
        limits: ZeroLimits = ZeroLimits(),
        drift: float = 0.0,
    ) -> None:
        self._initial = initial
        self._limits = limits
        self._behind = False
        self._initial_variance = initial_std_dev**2
        self._motions = [
            _Motion(initial, self._initial_variance, random_walk**2, drifts)
            for drifts in sorted({0.0, drift**2})
        ]
        self._sample_rate = sample_rate
        self._stamp: float | None = None
        self._scatter = 0.0  # weighted sum of the variances of the segments
        self._degrees = 0.0  # sum of the weights
        self._doubted: float | None = None  # reading in counts that is not confirmed yet
        self._has_read = False

    def _mean(self) -> tuple[float, float]:
        """Return the mean and the variance of the zero over the filters.

        Each filter is weighted by its likelihood. The variance includes the differences between the
        filters.
        """
        most = max(each.evidence for each in self._motions)
        shares = [math.exp(each.evidence - most) for each in self._motions]
        total = sum(shares)
        pairs = [(share / total, each) for share, each in zip(shares, self._motions, strict=True)]
        value = sum(share * each.value for share, each in pairs)
        parts = (share * (each.variance + (each.value - value) ** 2) for share, each in pairs)
        return value, sum(parts)

    def update(self, time: float, counts: NDArray[np.int32], settled: bool = True) -> Zero:
        """Update the zero by a segment of the empty belt that ends at `time` in s.

        `counts` has the shape (n,). If the segment is unstable or has fewer than two samples, or if
        its reading must be confirmed by a second segment, the zero is only predicted. If the
        segment has not `settled` after a product, the variance of its samples is used. The effect
        of the ring-down is similar after each product, so that it does not average out.
        """
        allowed = -math.inf, math.inf
        if self._stamp is not None:
            elapsed = max(time - self._stamp, 0.0)
            most = self._limits.rate * elapsed if elapsed > 0 else 0.0
            value, _ = self._mean()
            allowed = value - most, value + most
            for each in self._motions:
                each.carry_on(elapsed)
                each.value = _within(each.value, allowed)
        self._stamp = time
        readings = counts.astype(np.float64)
        if len(readings) >= 2 and self._is_at_rest(readings):
            self._follow(readings, settled, allowed)
        return self.zero

    def _follow(self, counts: Array, settled: bool, allowed: tuple[float, float]) -> None:
        known = self._scatter, self._degrees
        reading, noise = self._measure(counts, settled)
        value, variance = self._mean()
        if self._is_doubtful(reading, reading - value, noise):
            self._doubted, self._behind = reading, True
            self._scatter, self._degrees = known
            return
        self._doubted, self._has_read = None, True
        if (reading - value) ** 2 > _JUMP**2 * (variance + noise):
            # Reset the variances, so that the filters follow the jump. The zero jumps if dirt falls
            # on the belt or is removed.
            for each in self._motions:
                each.begin()
        left = [each.correct(reading, noise, allowed) for each in self._motions]
        held_back = any(each.value in allowed for each in self._motions)
        rest = reading - self._mean()[0]
        self._behind = held_back and rest**2 > _JUMP**2 * (max(left) + noise)

    def _is_doubtful(self, reading: float, change: float, noise: float) -> bool:
        """Return whether a reading differs so much from the zero that it needs confirmation."""
        drift = self._initial_variance
        if not self._has_read or change**2 <= _JUMP**2 * (drift + noise):
            return False
        return self._doubted is None or (reading - self._doubted) ** 2 > drift + 2 * noise

    def _is_at_rest(self, counts: Array) -> bool:
        """Return whether a segment is stable and has no outliers."""
        means = self._parts(counts, _SHORTEST_AVERAGE)
        if max(means) - min(means) > self._limits.stability:
            return False
        if self._number(counts, _PART) < _FEWEST_PARTS:
            return True
        parts = self._parts(counts, _PART)
        usual = median(parts)
        off = [abs(part - usual) for part in parts]
        least = _LEAST_OUTLYING * math.sqrt(self._initial_variance)
        return max(off) <= _OUTLYING * median(off) + least

    def _parts(self, counts: Array, duration: float) -> list[float]:
        """Return the Hann-weighted means of at least two parts of about `duration` in s.

        If the parts would contain no samples, the result is [0].
        """
        number = self._number(counts, duration)
        size = len(counts) // number
        if size == 0:
            return [0.0]
        parts = counts[len(counts) - number * size :].reshape(number, size)
        return [float(mean) for mean in hann_mean(parts)]

    def _number(self, counts: Array, duration: float) -> int:
        return max(2, int(len(counts) / (duration * self._sample_rate)))

    def set(self, time: float, counts: NDArray[np.int32]) -> float | None:
        """Set the zero by a segment of the empty belt that ends at `time` in s.

        Returns the reading in counts, which becomes the zero if it is within the range. If the
        segment is not stable or has fewer than two samples, the zero is not changed and None is
        returned. The reading of a segment of at least 1 s is its plain mean, with the variance by
        the method of batch means. The pooled variance of `update` is that of shorter segments.
        """
        readings = counts.astype(np.float64)
        if len(readings) < 2 or not self._is_at_rest(readings):
            return None
        reading, noise = self._measure(readings, True)
        if len(readings) >= BATCHES * _SHORTEST_AVERAGE * self._sample_rate:
            reading = float(np.mean(readings))
            noise = batch_mean_std_error(readings) ** 2 + _LEAST_NOISE * self._initial_variance
        if self.is_in_range(reading):
            self._stamp, self._behind = time, False
            self._doubted, self._has_read = None, True
            for each in self._motions:
                each.set(reading, min(noise, self._initial_variance))
        return reading

    def is_in_range(self, reading: float) -> bool:
        """Return whether a zero of `reading` counts is within the range."""
        return abs(reading - self._initial) <= self._limits.range

    def _measure(self, counts: Array, settled: bool) -> tuple[float, float]:
        """Return the reading of a segment in counts and its variance in counts^2."""
        least = _LEAST_NOISE * self._initial_variance
        if not settled:
            return float(hann_mean(counts)), float(np.var(counts)) + least
        if len(counts) < _SHORTEST_AVERAGE * self._sample_rate:
            return float(np.mean(counts)), float(np.var(counts)) + least
        half = len(counts) // 2
        difference = float(hann_mean(counts[:half]) - hann_mean(counts[-half:]))
        # The variance of each half is difference^2 / 2, and the variance of the mean of both halves
        # is difference^2 / 4.
        self._scatter = _MEMORY * self._scatter + difference**2 / 4
        self._degrees = _MEMORY * self._degrees + 1
        return float(hann_mean(counts)), self._scatter / self._degrees + least

    @property
    def zero(self) -> Zero:
        """Current zero."""
        value, variance = self._mean()
        trusted = not self._behind and self.is_in_range(value)
        return Zero(value, math.sqrt(variance), trusted)


def _within(value: float, allowed: tuple[float, float]) -> float:
    lowest, highest = allowed
    return min(max(value, lowest), highest)

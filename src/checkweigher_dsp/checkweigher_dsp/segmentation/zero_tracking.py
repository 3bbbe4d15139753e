# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reading of the empty belt, followed from product to product."""

from dataclasses import dataclass
import math
from statistics import median

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.averages import hann_mean

# An average over less than this is not free of the vibration of the belt.
_SHORTEST_AVERAGE = 0.1  # s
# Least variance of a reading, as a share of the initial one: a signal without noise must not stop
# the filter. Not in counts, so that the gain of the load cell does not matter.
_LEAST_NOISE = 1e-8
_JUMP = 4.0  # standard deviations
# A part of a segment is an outlier if it is off the median by more than this many median
# deviations of the parts plus this share of the initial standard deviation.
_OUTLYING, _LEAST_OUTLYING = 30.0, 0.02
_PART = 0.05  # s
_FEWEST_PARTS = 5
_MEMORY = 0.95  # weight of the scatter seen so far at each further segment
_EVIDENCE_MEMORY = 0.98  # the same of what tells whether there is a drift
_DRIFT_TIME = 600.0  # s, in which a drift becomes another one: temperatures settle


@dataclass(frozen=True, slots=True)
class Zero:
    """Reading of the empty belt and its standard deviation, counts, and whether to trust it."""

    counts: float
    std_dev: float
    trusted: bool = True


@dataclass(frozen=True, slots=True)
class ZeroLimits:
    """Limits of the tracking."""

    range: float = math.inf  # counts; a zero further from that of calibration cannot be trusted
    rate: float = math.inf  # counts a second; the zero is corrected no faster
    # Counts; a segment with two parts that differ by more is no empty belt at rest.
    stability: float = math.inf


class _Motion:
    """Kalman filter of a zero that moves in one way: at random, and by a drift if there may be one.

    The drift is an Ornstein-Uhlenbeck process. In counts and s; the variances are those of what a
    zero may be off at first, of a random walk in a second, and of drifts.
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
        """Return to the initial uncertainty of the zero."""
        self.variance = self._initial_variance
        self._drift, self._drift_variance = 0.0, self._drifts
        self._covariance = 0.0  # of zero and drift

    def set(self, value: float, variance: float) -> None:
        """Take a value for the zero; the drift goes on."""
        self.value, self.variance, self._covariance = value, variance, 0.0

    def carry_on(self, elapsed: float) -> None:
        """Carry the zero on for a time, s, by its drift and the doubt about both."""
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

    def log_likelihood(self, reading: float, noise: float) -> float:
        """Return how likely a reading of a variance `noise` is, but for a constant."""
        variance = self.variance + noise
        return -0.5 * ((reading - self.value) ** 2 / variance + math.log(variance))

    def correct(self, reading: float, noise: float, allowed: tuple[float, float]) -> float:
        """Correct zero and drift by a reading; return the variance that is left of the zero.

        Where the zero would leave what is allowed, it is held there, and no less is in doubt.
        """
        innovation, variance = reading - self.value, self.variance + noise
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
    """Follow the zero of a load cell by two Kalman filters: it walks at random, or drifts besides.

    A filter that knows no drift lags behind one by more than its readings scatter; one that looks
    for a drift where there is none scatters more. So both run, and each counts by the likelihood of
    the readings so far.

    Each empty segment of belt is one measurement, its Hann-weighted mean. Its variance follows
    from how far the means of the two halves of a segment are apart, pooled over the segments seen
    so far: that holds for any mixture of lines and noise. Averaging goes on from product to
    product, so that the moments between dense products are enough.

    A zero that has moved further than it can have drifted is believed when a second segment says
    the same: something may have stood on the belt that no eye had seen. Until then it is not to be
    trusted.

    The zero at calibration and how far it may have drifted since are in counts, the random walk is
    in counts per square root of a second, `drift`, the standard deviation of drifts, in counts per
    second, the sample rate in Hz. The limits are those that OIML R 51 asks for.

    References
    ----------
    R. E. Kalman, A new approach to linear filtering and prediction problems, J. Basic Eng. 82
    (1960) 35-45; the local level and the local linear trend. D. T. Magill, Optimal adaptive
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
        self._begin()
        self._sample_rate = sample_rate
        self._stamp: float | None = None
        self._scatter = 0.0  # sum of the variances that the halves of the segments give
        self._degrees = 0.0  # number of these
        self._doubted: float | None = None  # a reading that is yet to be seen again, counts
        self._has_read = False

    def _begin(self) -> None:
        """Return to the uncertainty of the zero at calibration."""
        for each in self._motions:
            each.begin()
        self._likelihoods = [0.0] * len(self._motions)  # logarithms

    @property
    def _shares(self) -> list[float]:
        """How much each motion counts, 1 in all."""
        most = max(self._likelihoods)
        shares = [math.exp(each - most) for each in self._likelihoods]
        return [each / sum(shares) for each in shares]

    @property
    def _value(self) -> float:
        pairs = zip(self._shares, self._motions, strict=True)
        return sum(share * each.value for share, each in pairs)

    @property
    def _variance(self) -> float:
        value, pairs = self._value, zip(self._shares, self._motions, strict=True)
        return sum(share * (each.variance + (each.value - value) ** 2) for share, each in pairs)

    def update(self, time: float, counts: NDArray[np.int32], settled: bool = True) -> Zero:
        """Take the samples of one empty segment, (n,), and return the zero at its end, `time` s.

        With fewer than two samples, and where they are not stable, the zero is only carried on.
        Those that have not settled count with their whole variance: what one oscillation does to
        the mean is alike at each product, and does not average out.
        """
        most = math.inf
        if self._stamp is not None:
            elapsed = max(time - self._stamp, 0.0)
            most = self._limits.rate * elapsed if elapsed > 0 else 0.0
        allowed = self._value - most, self._value + most
        if self._stamp is not None:
            for each in self._motions:
                each.carry_on(elapsed)
                each.value = _within(each.value, allowed)
        self._stamp = time
        readings = counts.astype(np.float64)
        if len(readings) >= 2 and self._is_at_rest(readings):
            self._follow(readings, settled, allowed)
        return self.zero

    def _follow(
        self, counts: NDArray[np.float64], settled: bool, allowed: tuple[float, float]
    ) -> None:
        known = self._scatter, self._degrees
        reading, noise = self._measure(counts, settled)
        if self._is_doubtful(reading, noise):
            self._doubted, self._behind = reading, True
            self._scatter, self._degrees = known
            return
        self._doubted, self._has_read = None, True
        if (reading - self._value) ** 2 > _JUMP**2 * (self._variance + noise):
            # Something has settled on the belt, or was wiped off it.
            self._begin()
        self._correct(reading, noise, allowed)

    def _is_doubtful(self, reading: float, noise: float) -> bool:
        """Tell whether a zero has moved too far to be believed at once."""
        drift = self._initial_variance
        if not self._has_read or (reading - self._value) ** 2 <= _JUMP**2 * (drift + noise):
            return False
        return self._doubted is None or (reading - self._doubted) ** 2 > drift + 2 * noise

    def _correct(self, reading: float, noise: float, allowed: tuple[float, float]) -> None:
        """Correct the zero of each motion, and how much each counts."""
        likelihoods = [each.log_likelihood(reading, noise) for each in self._motions]
        left = [each.correct(reading, noise, allowed) for each in self._motions]
        self._likelihoods = [
            _EVIDENCE_MEMORY * before + now
            for before, now in zip(self._likelihoods, likelihoods, strict=True)
        ]
        held_back = any(each.value in allowed for each in self._motions)
        rest = reading - self._value
        self._behind = held_back and rest**2 > _JUMP**2 * (max(left) + noise)

    def _is_at_rest(self, counts: NDArray[np.float64]) -> bool:
        """Tell whether a segment is stable and nothing stood on the belt for a part of it."""
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

    def _parts(self, counts: NDArray[np.float64], duration: float) -> list[float]:
        """Return the means of parts of a segment that last `duration`, or of its halves."""
        number = self._number(counts, duration)
        size = len(counts) // number
        if size == 0:
            return [0.0]
        parts = counts[len(counts) - number * size :].reshape(number, size)
        means: list[float] = hann_mean(parts).tolist()
        return means

    def _number(self, counts: NDArray[np.float64], duration: float) -> int:
        return max(2, int(len(counts) / (duration * self._sample_rate)))

    def set(self, time: float, counts: NDArray[np.int32]) -> float | None:
        """Take the reading of an empty belt for the zero, regardless of the zero before.

        Return the reading, counts, which is the zero from now on if it is within the range; None,
        and nothing has changed, if the segment is not stable.
        """
        readings = counts.astype(np.float64)
        if len(readings) < 2 or not self._is_at_rest(readings):
            return None
        reading, noise = self._measure(readings, True)
        if self.is_in_range(reading):
            self._stamp, self._behind = time, False
            self._doubted, self._has_read = None, True
            for each in self._motions:
                each.set(reading, min(noise, self._initial_variance))
        return reading

    def is_in_range(self, reading: float) -> bool:
        """Tell whether a zero of `reading` counts may be."""
        return abs(reading - self._initial) <= self._limits.range

    def _measure(self, counts: NDArray[np.float64], settled: bool) -> tuple[float, float]:
        """Return the reading of a segment and its variance, counts and counts^2."""
        least = _LEAST_NOISE * self._initial_variance
        if not settled:
            return float(hann_mean(counts)), float(np.var(counts)) + least
        if len(counts) < _SHORTEST_AVERAGE * self._sample_rate:
            return float(np.mean(counts)), float(np.var(counts)) + least
        half = len(counts) // 2
        difference = float(hann_mean(counts[:half]) - hann_mean(counts[-half:]))
        # The mean of two halves, each of variance difference^2 / 2.
        self._scatter = _MEMORY * self._scatter + difference**2 / 4
        self._degrees = _MEMORY * self._degrees + 1
        return float(hann_mean(counts)), self._scatter / self._degrees + least

    @property
    def zero(self) -> Zero:
        """The zero as it stands."""
        trusted = not self._behind and self.is_in_range(self._value)
        return Zero(self._value, math.sqrt(self._variance), trusted)


def _within(value: float, allowed: tuple[float, float]) -> float:
    lowest, highest = allowed
    return min(max(value, lowest), highest)

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
# A part of a segment stands out that is off the median by more than this many times what half of
# the parts are, and so much of the initial standard deviation.
_OUTLYING, _LEAST_OUTLYING = 30.0, 0.02
_PART = 0.05  # s
_FEWEST_PARTS = 5
_MEMORY = 0.95  # weight of the scatter seen so far at each further segment


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


class ZeroTracker:
    """Follow the zero of a load cell as a random walk, by a scalar Kalman filter.

    Each empty segment of belt is one measurement, its Hann-weighted mean. Its variance follows
    from how far the means of the two halves of a segment are apart, pooled over the segments seen
    so far: that holds for any mixture of lines and noise. Averaging goes on from product to
    product, so that the moments between dense products are enough.

    A zero that has moved further than it can have drifted is believed when a second segment says
    the same: something may have stood on the belt that no eye had seen. Until then it is not to be
    trusted.

    The zero at calibration and how far it may have drifted since are in counts, the drift
    (`random_walk`) is in counts per square root of a second, the sample rate in Hz. The limits are
    those that OIML R 51 asks for.

    References
    ----------
    R. E. Kalman, A new approach to linear filtering and prediction problems, J. Basic Eng. 82
    (1960) 35-45; the local-level case.
    """

    def __init__(
        self,
        initial: float,
        initial_std_dev: float,
        random_walk: float,
        sample_rate: float,
        limits: ZeroLimits = ZeroLimits(),
    ) -> None:
        self._value = self._initial = initial
        self._limits = limits
        self._behind = False
        self._initial_variance = initial_std_dev**2
        self._variance = self._initial_variance
        self._walk_variance = random_walk**2
        self._sample_rate = sample_rate
        self._stamp: float | None = None
        self._scatter = 0.0  # sum of the variances that the halves of the segments give
        self._degrees = 0.0  # number of these
        self._doubted: float | None = None  # a reading that is yet to be seen again, counts
        self._has_read = False

    def update(self, time: float, counts: NDArray[np.int32], settled: bool = True) -> Zero:
        """Take the samples of one empty segment, (n,), and return the zero at its end, `time` s.

        With fewer than two samples, and where they are not stable, the zero is only carried on.
        Those that have not settled count with their whole variance: what one oscillation does to
        the mean is alike at each product, and does not average out.
        """
        elapsed = math.inf
        if self._stamp is not None:
            elapsed = max(time - self._stamp, 0.0)
            self._variance += self._walk_variance * elapsed
            self._variance = min(self._variance, self._initial_variance)
        self._stamp = time
        readings = counts.astype(np.float64)
        if len(readings) >= 2 and self._is_at_rest(readings):
            self._follow(readings, settled, elapsed)
        return self.zero

    def _follow(self, counts: NDArray[np.float64], settled: bool, elapsed: float) -> None:
        known = self._scatter, self._degrees
        reading, noise = self._measure(counts, settled)
        innovation = reading - self._value
        if self._is_doubtful(reading, noise):
            self._doubted, self._behind = reading, True
            self._scatter, self._degrees = known
            return
        self._doubted, self._has_read = None, True
        if innovation**2 > _JUMP**2 * (self._variance + noise):
            # Something has settled on the belt, or was wiped off it: start afresh.
            self._variance = self._initial_variance
        self._correct(innovation, noise, elapsed)

    def _is_doubtful(self, reading: float, noise: float) -> bool:
        """Tell whether a zero has moved too far to be believed at once."""
        drift = self._initial_variance
        if not self._has_read or (reading - self._value) ** 2 <= _JUMP**2 * (drift + noise):
            return False
        return self._doubted is None or (reading - self._doubted) ** 2 > drift + 2 * noise

    def _correct(self, innovation: float, noise: float, elapsed: float) -> None:
        """Correct the zero, no further than the rate allows."""
        gain = self._variance / (self._variance + noise)
        correction = gain * innovation
        most = self._limits.rate * elapsed if elapsed > 0 else 0.0
        if abs(correction) <= most:
            self._variance *= 1 - gain
            self._behind = False
        else:
            correction = math.copysign(most, correction)
            rest = innovation - correction
            self._behind = rest**2 > _JUMP**2 * (self._variance * (1 - gain) + noise)
        self._value += correction

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
            self._value, self._stamp, self._behind = reading, time, False
            self._doubted, self._has_read = None, True
            self._variance = min(noise, self._initial_variance)
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

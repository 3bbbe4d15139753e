# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random disturbances: white noise, vibration of the floor, and slowly varying quantities."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Frequency band of the floor vibration in Hz, and noise bandwidth in Hz of the filter that limits
# white noise to this band. The noise bandwidth of a Butterworth filter of order 2 is
# pi/4 / sin(pi/4) times its width.
FLOOR_BAND = (4.0, 12.0)
FLOOR_BANDWIDTH = math.pi / 4 / math.sin(math.pi / 4) * (FLOOR_BAND[1] - FLOOR_BAND[0])

_WAVES = 12  # number of sines


def white(density: float, step: float, steps: int, random: np.random.Generator) -> Array:
    """Return white noise, (steps,), at intervals of `step` s.

    `density` is the square root of the one-sided power spectral density, in the unit of the noise
    per sqrt(Hz).
    """
    # The variance is the power density times the bandwidth, which is half the sampling rate.
    return density * math.sqrt(1 / step / 2) * random.standard_normal(steps)


class FloorNoise:
    """Vibration of a floor: noise in the band `FLOOR_BAND` with a standard deviation of 1."""

    def __init__(self, rate: float, random: np.random.Generator) -> None:
        """Create a generator that starts at rest, with a sampling rate of `rate` Hz."""
        from scipy.signal import butter  # imported late, because the import is slow

        self._random = random
        self._band = butter(2, FLOOR_BAND, 'bandpass', fs=rate, output='sos')
        self._state = np.zeros((len(self._band), 2))
        self._share = math.sqrt(FLOOR_BANDWIDTH / (rate / 2))

    def __call__(self, steps: int) -> Array:
        """Return the next values of the vibration, (steps,)."""
        from scipy.signal import sosfilt

        white = self._random.standard_normal(steps) / self._share
        shaking, self._state = sosfilt(self._band, white, zi=self._state)
        return np.asarray(shaking)


class Wander:
    """Random function of one variable with mean 0 and standard deviation 1.

    The function is flicker noise: a sum of sines with random phases and equal power in each octave
    of a frequency band. The distribution of the values is approximately normal. The function has no
    state, so it can be evaluated at any argument.
    """

    def __init__(self, random: np.random.Generator, slowest: float, fastest: float) -> None:
        """Draw a function with frequencies from `slowest` to `fastest`.

        The frequencies are in cycles per unit of the argument, which is s or m, for example.
        """
        steps = (np.arange(_WAVES) + random.random(_WAVES)) / _WAVES
        self._rates = 2 * math.pi * slowest * (fastest / slowest) ** steps
        self._phases = 2 * math.pi * random.random(_WAVES)
        self._fastest = fastest

    def __call__(self, at: Array) -> Array:
        """Return the values of the function, (n,), at n > 0 ascending arguments, (n,)."""
        # There are 20 knots per period of the fastest sine, so linear interpolation is sufficient.
        knots = np.arange(math.floor(at[0] * 20 * self._fastest), at[-1] * 20 * self._fastest + 2)
        knots /= 20 * self._fastest
        waves = np.sin(np.multiply.outer(knots, self._rates) + self._phases)
        return np.interp(at, knots, math.sqrt(2 / _WAVES) * waves.sum(axis=1))

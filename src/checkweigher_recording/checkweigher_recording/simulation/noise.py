# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random functions: white noise, vibration of the floor, and slow wander of a phase or zero."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLOOR_BAND = (4.0, 12.0)  # Hz
# Noise bandwidth of a Butterworth filter of order 2: pi/4 / sin(pi/4) times its width.
FLOOR_BANDWIDTH = math.pi / 4 / math.sin(math.pi / 4) * (FLOOR_BAND[1] - FLOOR_BAND[0])

_WAVES = 12


def white(density: float, step: float, steps: int, random: np.random.Generator) -> Array:
    """Return white noise at steps of `step` s; `density` is the root of its one-sided density."""
    # The variance is the power density times the bandwidth, which is half the step rate.
    return density * math.sqrt(1 / step / 2) * random.standard_normal(steps)


class FloorNoise:
    """Vibration of a floor: noise of standard deviation 1 within `FLOOR_BAND`."""

    def __init__(self, rate: float, random: np.random.Generator) -> None:
        """Begin at rest, at `rate` steps a second."""
        from scipy.signal import butter  # the import takes half a second

        self._random = random
        self._band = butter(2, FLOOR_BAND, 'bandpass', fs=rate, output='sos')
        self._state = np.zeros((len(self._band), 2))
        self._share = math.sqrt(FLOOR_BANDWIDTH / (rate / 2))

    def __call__(self, steps: int) -> Array:
        """Return the next steps, (steps,)."""
        from scipy.signal import sosfilt

        white = self._random.standard_normal(steps) / self._share
        shaking, self._state = sosfilt(self._band, white, zi=self._state)
        return np.asarray(shaking)


class Wander:
    """Random function of time or travel, about normal, with mean 0 and standard deviation 1.

    It is flicker noise: a sum of sines with random phases and the same power in each octave of a
    band of rates. It has no state, so that any stretch of it can be computed.
    """

    def __init__(self, random: np.random.Generator, slowest: float, fastest: float) -> None:
        """Draw a function with rates in a band, in cycles per unit of its argument."""
        steps = (np.arange(_WAVES) + random.random(_WAVES)) / _WAVES
        self._rates = 2 * math.pi * slowest * (fastest / slowest) ** steps
        self._phases = 2 * math.pi * random.random(_WAVES)
        self._fastest = fastest

    def __call__(self, at: Array) -> Array:
        """Return the function at (n,) ascending arguments."""
        # Interpolate linearly between knots that are dense enough for the fastest sine.
        knots = np.arange(math.floor(at[0] * 20 * self._fastest), at[-1] * 20 * self._fastest + 2)
        knots /= 20 * self._fastest
        waves = np.sin(np.multiply.outer(knots, self._rates) + self._phases)
        return np.interp(at, knots, math.sqrt(2 / _WAVES) * waves.sum(axis=1))

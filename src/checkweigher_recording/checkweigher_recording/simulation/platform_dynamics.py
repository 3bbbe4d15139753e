# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Exact integration of the motion of a platform, which is a mass on a spring and a damper."""

from dataclasses import dataclass, field
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.platform_response import Platform
from checkweigher_recording.simulation.noise import Array


@dataclass
class PlatformDynamics:
    """Second-order platform whose moving mass includes the load on it.

    The reading y is the displacement times stiffness / g, and f is the force divided by g, both in
    kg. If the mass is constant and the force is constant during each step, the solution

        y(k+1) = a11 y(k) + a12 v(k) + (1 - a11) f(k), v(k+1) = a21 y(k) + a22 v(k) - a21 f(k)

    is exact, where v is the derivative of y. When the mass changes, y and v are continuous. The
    solution is computed as the filter

        y(k) = (a11 + a22) y(k-1) - det(A) y(k-2) + b1 f(k-1) + b2 f(k-2)

    in transposed direct form II with the state (y, a12 v - a22 y). Here A is the matrix of a11,
    a12, a21 and a22, b1 = 1 - a11, and b2 = -a12 a21 - a22 (1 - a11). The gain of the filter for a
    constant force is 1 at any mass.
    """

    platform: Platform  # empty platform
    step: float  # integration step in s
    _reading: float = field(default=0.0, init=False)
    _rate: float = field(default=0.0, init=False)

    def run(self, force: Array, bounds: NDArray[np.intp], loads: Array) -> Array:
        """Return the reading at the start of each of the next n steps, (n,) in kg.

        `force` is the force during each step, (n,) in kg. The load on the platform is ``loads[i]``,
        (m,) in kg, from the step ``bounds[i]`` to the step ``bounds[i + 1]``; `bounds` ascends from
        0 to n, (m + 1,).
        """
        reading = np.empty(len(force))
        for begin, end, load in zip(bounds[:-1], bounds[1:], loads, strict=True):
            reading[begin:end] = self._run_at(force[begin:end], float(load))
        return reading

    def _run_at(self, force: Array, load: float) -> Array:
        from scipy.signal import lfilter  # imported late, because the import is slow

        a11, a12, a21, a22 = self.transition(load)
        b1, b2 = 1 - a11, -a12 * a21 - a22 * (1 - a11)
        state = np.array((self._reading, a12 * self._rate - a22 * self._reading))
        reading, (last, other) = lfilter(
            (0.0, b1, b2), (1.0, -a11 - a22, a11 * a22 - a12 * a21), force, zi=state
        )
        self._reading = float(last)
        self._rate = (float(other) + a22 * self._reading) / a12
        return np.asarray(reading)

    def transition(self, load: float) -> tuple[float, float, float, float]:
        """Return the transition matrix a11, a12, a21, a22 of one step for a load in kg."""
        # The load changes the mass, but neither the stiffness nor the damping coefficient.
        empty = self.platform
        share = empty.moving_mass / (empty.moving_mass + load)
        omega = 2 * math.pi * empty.natural_frequency
        squared = omega**2 * share
        decay = empty.damping_ratio * omega * share
        damped = math.sqrt(squared - decay**2)
        envelope = math.exp(-decay * self.step)
        cosine = envelope * math.cos(damped * self.step)
        sine = envelope * math.sin(damped * self.step) / damped
        return cosine + decay * sine, sine, -squared * sine, cosine - decay * sine

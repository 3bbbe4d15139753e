# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Smallest standard deviation of an unbiased linear estimate of a simulated mass.

The signal of a pass is r = M s + n, where M is the mass, s is the response of the platform to a
load of 1 kg, and n is noise with the covariance C. By the theorem of Gauss and Markov, the smallest
variance of an unbiased linear estimate of M is :math:`1 / (s^T C^{-1} s)`. Since s and C are known
for a simulated pass, the accuracy of an estimator can be compared with this bound.

C is the sum of four covariances. The vibrations of rollers and motor are sines with known
amplitudes and random phases. The broadband noise and the vibration of the floor are white noise
filtered by a linear system. The impact at entry has a known form and a random size. The converter
adds noise and quantisation. All forces act on the platform, whose moving mass increases while the
product enters the belt.

The vibration that the previous product has caused is assumed to be known. The change of s with the
unknown mass is also assumed to be known. The change of s is a few parts in a thousand, and would
give an estimator almost no information.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, reduce
import math
from operator import mul

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, norm, solve_discrete_lyapunov, solve_triangular
from scipy.signal import StateSpace, butter, tf2ss

from checkweigher_dsp.signal.platform_response import Platform
from checkweigher_recording.simulation.belt_travel import STEADY, BeltTravel
from checkweigher_recording.simulation.noise import FLOOR_BAND, FLOOR_BANDWIDTH
from checkweigher_recording.simulation.platform_dynamics import PlatformDynamics
from checkweigher_recording.simulation.simulator import (
    DAMPING_RATIO,
    IMPACT_DURATION,
    MOVING_MASS,
    OVERSAMPLING,
    PROFILES,
    ROLLER_DIAMETER,
    SimulationParameters,
)

# Time in s after which a transient on the softest platform is below 1e-7 of its first amplitude.
_SETTLING = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class PassModel:
    """Response of the platform and covariance of the noise in a simulated pass."""

    time: NDArray[np.float64]  # time of each sample up to t3, (n,), in s from t1
    response: NDArray[np.float64]  # reading per kg of product, (n,)
    covariance: NDArray[np.float64]  # covariance of the noise, (n, n), in kg^2


def bound(parameters: SimulationParameters, mass: float, before: float = 0.3) -> float:
    """Return the Gauss-Markov bound of the standard deviation of a mass in kg.

    `parameters` contains the machine, the belt speed, and the lengths of belt and product. Its
    masses are not used. `mass` is the mass of the product in kg. An estimate may use the signal
    from `before` s before t1 up to t3. The zero is assumed to be known exactly.
    """
    return bound_of(pass_model(parameters, mass, before))


def bound_of(model: PassModel) -> float:
    """Return the Gauss-Markov bound in kg for a signal with known response and covariance."""
    root = cholesky(model.covariance, lower=True)
    return float(1 / norm(solve_triangular(root, model.response, lower=True)))


def pass_model(parameters: SimulationParameters, mass: float, before: float = 0.3) -> PassModel:
    """Return the response of the platform and the covariance of the noise in a pass.

    The parameters are as in `bound`.
    """
    simulated = _SimulatedPass(parameters, mass, before)
    noise = simulated.lines() + simulated.impact() + simulated.white_noise()
    return PassModel(simulated.sample_time(), simulated.response(simulated.load) / mass, noise)


class _SimulatedPass:
    """Pass of one product over an empty belt, with the integration steps of the simulator.

    `load` is the force of the product in each step, (steps,) in kg.
    """

    def __init__(self, parameters: SimulationParameters, mass: float, before: float) -> None:
        self._profile = PROFILES[parameters.profile]
        self._parameters = parameters
        self._mass = mass
        sample_rate = parameters.sample_rate
        self._step = 1 / (OVERSAMPLING * sample_rate)
        # Place t1 at a sample, because its position between two samples has little effect on the
        # bound. If the sample rate is a whole number, t1 is also at a whole second, so that
        # rounding errors hardly depend on `before`.
        entry = math.ceil(math.ceil(_SETTLING + before) * sample_rate)
        last = math.ceil(round((parameters.weigh_length / parameters.speed) * sample_rate, 6))
        self._first = entry - round(before * sample_rate)
        self._entry = entry
        self._samples = entry + last
        self._t1 = entry / sample_rate
        line = replace(parameters, masses=(mass,), count=1, lead_in=self._t1)
        belt = BeltTravel(line, STEADY, np.random.default_rng(0))
        steps = np.arange(self._samples * OVERSAMPLING, dtype=np.float64)
        self._time = (steps + 0.5 - (OVERSAMPLING - 1) / 2) * self._step
        belt.plan(float(self._time[0]), float(self._time[-1]))
        self._travel = belt.travel(self._time)
        self.load = belt.load(self._time, self._travel)
        self._bounds, self._loads = belt.load_steps(self._time, self._travel)

    def sample_time(self) -> NDArray[np.float64]:
        """Return the times of the samples that an estimate may use, in s from t1."""
        return (np.arange(self._first, self._samples) - self._entry) / self._parameters.sample_rate

    def response(self, force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the samples that result from a force in each step, (steps,) in kg."""
        reading = self._platform().run(force, self._bounds, self._loads)
        return np.asarray(reading.reshape(-1, OVERSAMPLING).mean(axis=1)[self._first :])

    def lines(self) -> NDArray[np.float64]:
        """Return the covariance of the roller and motor vibrations, (n, n) in kg^2.

        Their phases are random.
        """
        profile, speed = self._profile, self._parameters.speed
        angles = [
            (amplitude, 2 * order / ROLLER_DIAMETER)
            for order, amplitude in enumerate(profile.roller, start=1)
        ]
        angles.append((profile.motor, 2 * math.pi * profile.motor_frequency))
        parts = [
            # A sine of random phase is a sum of uncorrelated sine and cosine with half its power.
            speed * amplitude / math.sqrt(2) * self.response(wave(angle * self._travel))
            for amplitude, angle in angles
            if amplitude
            for wave in (np.sin, np.cos)
        ]
        matrix = np.array(parts).reshape(-1, self._samples - self._first)
        return np.asarray(matrix.T @ matrix)

    def impact(self) -> NDArray[np.float64]:
        """Return the covariance of the impact at entry, (n, n) in kg^2.

        The impact has a known form and a random size.
        """
        size = self._profile.impact * self._mass * self._parameters.speed
        phase = (self._time - self._t1) / IMPACT_DURATION
        force = np.where((phase >= 0) & (phase < 1), size * np.sin(math.pi * phase), 0.0)
        form = self.response(force)
        return np.asarray(np.outer(form, form), np.float64)

    def white_noise(self) -> NDArray[np.float64]:
        """Return the covariance of the white and the filtered white noise, (n, n) in kg^2.

        The sources of the noise are the broadband noise, the vibration of the floor, and the noise
        and quantisation of the converter.
        """
        covariance = self._shaken(self._broadband()) + self._shaken(self._floor())
        step = 1 / self._parameters.counts_per_kg
        covariance += np.eye(len(covariance)) * (self._profile.electronic**2 + step**2 / 12)
        return covariance

    def _broadband(self) -> StateSpace:
        """Return the stateless system that generates the broadband noise from white noise."""
        half_rate = 1 / (2 * self._step)
        force = self._profile.broadband * self._parameters.speed * math.sqrt(half_rate)
        return StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), force, dt=1)

    def _floor(self) -> StateSpace:
        """Return the band-pass filter that generates the floor vibration from white noise."""
        rate = 1 / self._step
        sections = butter(2, FLOOR_BAND, 'bandpass', fs=rate, output='sos')
        size = self._profile.floor / math.sqrt(FLOOR_BANDWIDTH / (rate / 2))
        return reduce(mul, (StateSpace(*tf2ss(one[:3], one[3:]), dt=1) for one in sections)) * size

    def _shaken(self, force: StateSpace) -> NDArray[np.float64]:
        """Return the covariance of the samples, (n, n) in kg^2, for a filtered white-noise force.

        The input of the system `force` is white noise of variance 1, and its output is the force on
        the platform. The joint state contains the reading, its derivative and the state of `force`.
        """

        def step(load: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            a11, a12, a21, a22 = self._platform().transition(load)
            push = np.array(((1 - a11,), (-a21,)))
            own = np.array(((a11, a12), (a21, a22)))
            whole = np.block([[own, push @ force.C], [np.zeros((len(force.A), 2)), force.A]])
            return whole, np.concatenate((push @ force.D, force.B))[:, 0]

        loads = np.repeat(self._loads, np.diff(self._bounds)).reshape(-1, OVERSAMPLING)
        return _covariance_of_readings(step, loads[self._first :])

    def _platform(self) -> PlatformDynamics:
        platform = Platform(self._profile.natural_frequency, DAMPING_RATIO, MOVING_MASS)
        return PlatformDynamics(platform, self._step)


def _covariance_of_readings(
    step: Callable[[float], tuple[NDArray[np.float64], NDArray[np.float64]]],
    loads: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the covariance of n samples, (n, n), each of which is the mean reading of its steps.

    `step` is a function of the load in kg that returns the matrices F, (d, d), and G, (d,), of one
    step. The state equation of a step is x' = F x + G w, in which w is white noise and x[0] is the
    reading. `loads` contains the load in each step of each sample, (n, steps) in kg. The process is
    stationary before the first sample.
    """
    whole, drive = step(float(loads[0, 0]))
    size = len(drive)
    state = solve_discrete_lyapunov(whole, np.outer(drive, drive))
    covariance = np.empty((len(loads), len(loads)))
    cross = np.empty((size, 0))  # covariance between the state and the samples so far
    over_sample = cache(lambda *row: _sample_step([step(load) for load in row]))
    for index, row in enumerate(loads.tolist()):
        over, noise = over_sample(*row)
        joint = over @ state @ over.T + noise
        state, own = joint[:size, :size], joint[:size, size]
        cross = over @ cross
        covariance[index, :index] = covariance[:index, index] = cross[size]
        covariance[index, index] = joint[size, size]
        cross = np.column_stack((cross[:size], own))
    return covariance


def _sample_step(
    steps: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the transition matrix of one sample, (d + 1, d), and the covariance of its noise.

    The shape of the covariance is (d + 1, d + 1). The last row of both matrices belongs to the
    sample, and the other rows belong to the state.
    """
    size = len(steps[0][1])
    over = np.eye(size + 1, size)
    noise = np.zeros((size + 1, size + 1))
    for whole, drive in steps:
        single = np.eye(size + 1)
        single[:size, :size] = whole
        single[size, 0] = 1 / len(steps)
        push = np.append(drive, 0.0)
        over = single @ over
        noise = single @ noise @ single.T + np.outer(push, push)
    return over, noise

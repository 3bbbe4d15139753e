# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The platform against the solution of its differential equation."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from checkweigher_dsp.signal.platform_response import Platform
from checkweigher_recording.simulation.belt_travel import STEADY, BeltTravel
from checkweigher_recording.simulation.platform_dynamics import PlatformDynamics
from checkweigher_recording.simulation.simulator import SimulationParameters

FREQUENCY, DAMPING, MASS, STEP = 38.0, 0.06, 2.5, 1 / 7680


def _run(force, load, frequency=FREQUENCY):
    platform = PlatformDynamics(Platform(frequency, DAMPING, MASS), STEP)
    return platform.run(force, np.array((0, len(force))), np.array((load,)))


@pytest.mark.parametrize('load', [0.0, 0.0745, 0.2545, 2.5])
def test_a_resting_load_reads_exactly_its_mass(load):
    reading = _run(np.full(7680 * 5, load), load)

    # The ring-down is over: e^(-xi w t) < 1e-20 after 5 s.
    assert reading[-1] == pytest.approx(load, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize('load', [0.0, 0.2545])
def test_ring_down_has_the_frequency_and_damping_of_theory(load):
    # Step response of y'' = w^2 (1 - y) - 2 d y', with stiffness and damper of the empty platform.
    squared = (2 * math.pi * FREQUENCY) ** 2 * MASS / (MASS + load)
    decay = DAMPING * 2 * math.pi * FREQUENCY * MASS / (MASS + load)
    damped = math.sqrt(squared - decay**2)
    time = np.arange(7680) * STEP
    theory = 1 - np.exp(-decay * time) * (
        np.cos(damped * time) + decay / damped * np.sin(damped * time)
    )

    np.testing.assert_allclose(_run(np.ones(7680), load), theory, atol=1e-9)


def test_a_change_of_the_load_leaves_no_trace():
    force = np.random.default_rng(1).standard_normal(1000)
    platform = PlatformDynamics(Platform(FREQUENCY, DAMPING, MASS), STEP)
    parts = [
        platform.run(force[begin:end], np.array((0, end - begin)), np.array((0.1,)))
        for begin, end in ((0, 1), (1, 400), (400, 1000))
    ]

    np.testing.assert_allclose(np.concatenate(parts), _run(force, 0.1), atol=1e-12)


def test_a_product_that_rolls_on_moves_the_platform_as_the_equation_says():
    line = SimulationParameters(speed=1.5, masses=(0.25,), count=1, lead_in=0.01)
    belt = BeltTravel(line, STEADY, np.random.default_rng(1))
    belt.plan(-0.1, 0.5)
    time = np.arange(1920) * STEP
    middle = time + STEP / 2
    travel = belt.travel(middle)
    platform = PlatformDynamics(Platform(FREQUENCY, DAMPING, MASS), STEP)
    reading = platform.run(belt.load(middle, travel), *belt.load_steps(middle, travel))

    def share(t):
        way = (t - 0.01) * 1.5
        return min(max(way / 0.1, 0), 1) - min(max((way - 0.2) / 0.1, 0), 1)

    def slope(t, state):
        load = 0.25 * share(t)
        omega = 2 * math.pi * FREQUENCY
        ratio = MASS / (MASS + load)
        return state[1], omega**2 * ratio * (load - state[0]) - 2 * DAMPING * omega * ratio * state[
            1
        ]

    solution = solve_ivp(
        slope, (0, 0.25), (0, 0), t_eval=time, rtol=1e-9, atol=1e-12, max_step=1e-3
    )
    # The moving mass goes in stairs: at most 1/32 of 0.25 kg wrong, 0.3 % of the platform's, and
    # as much of the oscillation's size, which is 15 g.
    np.testing.assert_allclose(reading, solution.y[0], atol=0.0003 * 0.25)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The closed forms of the platform against integrations that know nothing of them."""

from itertools import pairwise
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from checkweigher_dsp.denoising.load_rise import load_response
from checkweigher_dsp.signal.platform_response import Crossing, Platform, responses

PLATFORM = Platform(38.0, 0.06, 2.5)
CROSSING = Crossing(0.0, 0.1, 0.2, 0.3)
RATE = 960.0
ROUNDING = 1e-10
STAIRS = 8  # over which the mass of a product comes on and goes off


def _time(begin=-0.1, end=0.4):
    return np.arange(round(begin * RATE), round(end * RATE)) / RATE + 1e-4


def _share_in_stairs(time, crossing):
    """Share of the product that moves with the platform, constant in each eighth of a ramp."""
    if time >= crossing.off_begin:
        on, way = 1.0, (time - crossing.off_begin) / (crossing.off_end - crossing.off_begin)
    else:
        on, way = 0.0, (time - crossing.on_begin) / (crossing.on_end - crossing.on_begin)
    share = 0.0 if way < 0 else min((math.floor(STAIRS * way) + 0.5) / STAIRS, 1.0)
    share = 1.0 if way >= 1 else share
    return abs(on - share)


def _integrate(platform, mass, crossing, time, start=(0.0, 0.0), kick=(0.0, 0.0)):
    """Step the platform on by matrix exponentials of (y, y', load, rate of the load)."""
    omega = 2 * math.pi * platform.natural_frequency
    ramps = [(crossing.on_begin, crossing.on_end, 1.0)]
    if math.isfinite(crossing.off_begin):
        ramps.append((crossing.off_begin, crossing.off_end, -1.0))
    bounds = np.concatenate([np.linspace(a, b, STAIRS + 1) for a, b, _ in ramps])
    grid = np.unique(np.concatenate([time, bounds[bounds > time[0]]]))
    state, seen = np.array([*start, 0.0, 0.0]), {time[0]: start[0]}
    for now, then in pairwise(grid):
        middle = (now + then) / 2
        if now == crossing.on_begin:
            state[:2] += kick
        state[3] = sum(sign / (b - a) for a, b, sign in ramps if a < middle < b)
        ease = platform.moving_mass / (
            platform.moving_mass + mass * _share_in_stairs(middle, crossing)
        )
        w2, damping = ease * omega**2, 2 * ease * platform.damping_ratio * omega
        matrix = np.array([[0, 1, 0, 0], [-w2, -damping, w2, 0], [0, 0, 0, 1], [0, 0, 0, 0]], float)
        state = expm((then - now) * matrix) @ state
        seen[then] = state[0]
    return np.array([seen[t] for t in time])


@pytest.mark.parametrize('mass', [0.0, 0.2, 2.5])
@pytest.mark.parametrize(
    'crossing',
    [CROSSING, Crossing(0.0, 0.1), Crossing(0.013, 0.08, 0.15, 0.2717)],
    ids=['on and off', 'on', 'elsewhere'],
)
def test_the_response_to_a_load_agrees_with_matrix_exponentials(mass, crossing):
    time = _time()
    shape = responses(PLATFORM, mass, crossing, time)[0]
    np.testing.assert_allclose(shape, _integrate(PLATFORM, mass, crossing, time), atol=ROUNDING)


@pytest.mark.parametrize('mass', [0.0, 0.2, 2.5])
def test_free_oscillations_agree_with_matrix_exponentials(mass):
    time, omega = _time(), 2 * math.pi * 38.0
    nothing = _integrate(PLATFORM, mass, CROSSING, time)

    rows = responses(PLATFORM, mass, CROSSING, time)

    causes = [{'start': (1.0, 0.0)}, {'start': (0.0, omega)},
              {'kick': (1.0, 0.0)}, {'kick': (0.0, omega)}]  # fmt: skip
    for row, cause in zip(rows[1:], causes, strict=True):
        expected = _integrate(PLATFORM, mass, CROSSING, time, **cause) - nothing
        np.testing.assert_allclose(row, expected, atol=ROUNDING)


@pytest.mark.parametrize(('mass', 'error'), [(0.0745, 1e-4), (0.2545, 4e-4)])
def test_stairs_are_off_by_less_than_stated_where_the_mass_comes_on_evenly(mass, error):
    time, omega, m0 = _time(0.0), 2 * math.pi * 38.0, 2.5

    def motion(t, state):
        share = np.interp(t, [0.0, 0.1, 0.2, 0.3], [0.0, 1.0, 1.0, 0.0])
        ease = m0 / (m0 + mass * share)
        y, slope = state
        return [slope, ease * (omega**2 * (share - y) - 2 * 0.06 * omega * slope)]

    exact = solve_ivp(
        motion, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-12, max_step=2e-3
    ).y[0]

    shape = responses(PLATFORM, mass, CROSSING, np.append(0.0, time))[0, 1:]

    assert np.abs(shape - exact).max() < error
    # No stairs at all, the whole mass from t1 on, are worse.
    lumped = load_response(
        time, 0.1, *(value * math.sqrt(m0 / (m0 + mass)) for value in (38.0, 0.06))
    )
    until = time < 0.2
    assert np.abs(shape - exact)[until].max() < np.abs(lumped - exact)[until].max() / 3

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The load's rise against its definition, and the platform's answer against an integrated one."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from checkweigher_dsp.denoising.load_rise import block_responses, load_response, load_share

INTEGRATION = 1e-8  # relative tolerance of the integrated response
TIME = np.arange(-0.05, 0.3, 1 / 960)


def _integrated(rise, frequency, damping):
    """Integrate y'' = w^2 (f - y) - 2 xi w y' for a load that rises to 1 over `rise`."""
    omega = 2 * math.pi * frequency

    def slope(time, state):
        load = min(time / rise, 1.0)
        return [state[1], omega**2 * (load - state[0]) - 2 * damping * omega * state[1]]

    after = TIME[TIME >= 0]
    solution = solve_ivp(
        slope, (0, TIME[-1]), [0.0, 0.0], t_eval=after, rtol=INTEGRATION / 10, atol=1e-12,
        max_step=rise / 20,
    )  # fmt: skip
    return np.concatenate([np.zeros(len(TIME) - len(after)), solution.y[0]])


@pytest.mark.parametrize(
    ('rise', 'frequency', 'damping'), [(0.1, 38.0, 0.06), (0.067, 22.0, 0.2), (0.2, 60.0, 0.0)]
)
def test_the_response_is_that_of_the_integrated_platform(rise, frequency, damping):
    np.testing.assert_allclose(
        load_response(TIME, rise, frequency, damping),
        _integrated(rise, frequency, damping),
        atol=100 * INTEGRATION,
    )


@pytest.mark.parametrize('rise', [0.0, -1.0])
def test_without_a_rise_the_load_is_there_at_once(rise):
    time = np.array([-0.01, 0.01])
    np.testing.assert_array_equal(load_share(time, rise), [0.0, 1.0])
    assert np.isfinite(load_response(time, rise, 38.0, 0.06)).all()


def test_each_pass_may_have_a_rise_and_a_platform_of_its_own():
    rises, frequencies = np.array([[0.1], [0.2]]), np.array([[38.0], [22.0]])
    both = load_response(np.stack([TIME, TIME]), rises, frequencies, 0.06)
    np.testing.assert_array_equal(both[0], load_response(TIME, 0.1, 38.0, 0.06))
    np.testing.assert_array_equal(both[1], load_response(TIME, 0.2, 22.0, 0.06))


@pytest.mark.parametrize(
    ('rise', 'frequency', 'damping'), [(0.1, 38.0, 0.06), (0.031, 22.0, 0.5), (0.2, 60.0, 0.0)]
)
def test_block_responses_are_means_of_the_response_and_differences_of_such(
    rise, frequency, damping
):
    bounds = np.arange(-0.05, 0.3, 1 / 240)
    points = 200
    time = bounds[:-1, None] + (np.arange(points) + 0.5) / points / 240

    def mean(late1=0.0, late2=0.0):
        return load_response(time - late1, rise + late2 - late1, frequency, damping).mean(axis=1)

    response, of_t1, of_t2 = block_responses(bounds, rise, frequency, damping)

    step = 1e-6
    np.testing.assert_allclose(response, mean(), atol=1e-7)
    slopes = [
        (mean(step) - mean(-step)) / (2 * step), (mean(0, step) - mean(0, -step)) / (2 * step)
    ]  # fmt: skip
    np.testing.assert_allclose([of_t1, of_t2], slopes, atol=1e-5 * np.abs(slopes).max())


def test_a_rise_of_no_length_has_responses_as_well():
    assert np.isfinite(block_responses(np.arange(-0.05, 0.3, 1 / 240), 0.0, 38.0, 0.06)).all()

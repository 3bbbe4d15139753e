# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The FIR model against the Gauss-Markov theorem and numbers worked by hand."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators.fir_model import fir_weights, fit_fir

ROUNDING = 1e-12
RATE = 960.0


def fir_estimate(samples, knots):
    return samples @ fir_weights(knots, samples.shape[-1])


def _lines(passes, count, frequency, seed, masses, amplitude=0.01):
    """Constant loads on a line of random phase."""
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, (passes, 1))
    time = np.arange(count) / RATE
    return masses[:, None] + amplitude * np.cos(2 * np.pi * frequency * time + phase)


@given(st.integers(0, 2**32 - 1), st.integers(2, 32), st.integers(1, 200))
def test_a_constant_load_is_shown_by_any_knots(seed, count, length):
    knots = np.random.default_rng(seed).uniform(0.1, 1, count)
    result = fir_estimate(np.full((2, length), 0.25), knots)
    assert result == pytest.approx([0.25, 0.25], rel=ROUNDING)


@pytest.mark.parametrize('masses', [np.full(24, 0.1), np.repeat([0.1, 0.2, 0.3], 8)])
def test_with_a_knot_a_sample_the_weights_are_those_of_gauss_and_markov(masses):
    # The passes of each mass are M + rows of a matrix whose sample covariance is exactly C.
    count = 4
    factor = np.random.default_rng(7).standard_normal((count, count))
    covariance = factor @ factor.T + np.eye(count)
    rows = np.sqrt(count) * np.linalg.cholesky(covariance).T
    noise = 1e-3 * np.tile(np.concatenate([rows, -rows]), (3, 1))
    inverse = np.linalg.solve(covariance, np.ones(count))

    knots = fit_fir(masses[:, None] + noise, masses, count, ridge=0)

    assert fir_weights(knots, count) == pytest.approx(inverse / inverse.sum(), abs=1e-6)


def test_white_noise_is_averaged_nearly_as_well_as_the_plain_mean_does():
    # Straight lines at 16 knots span the uniform weights; learning from 2000 passes beyond
    # that costs (knots - 1) / passes of the variance.
    rng = np.random.default_rng(3)
    masses = np.full(2000, 0.2)
    windows = masses[:, None] + 1e-3 * rng.standard_normal((2000, 64))

    weights = fir_weights(fit_fir(windows, masses, 16, ridge=0), 64)

    assert 1 / 64 <= weights @ weights < (1 + 3 * 15 / 2000) / 64


@pytest.mark.parametrize('frequency', [10.0, 22.0, 38.0])
def test_a_line_is_taken_out_also_of_windows_of_other_lengths(frequency):
    masses = np.repeat([0.1, 0.2], 40)
    amplitude = 0.01
    windows = _lines(80, 192, frequency, 1, masses, amplitude)

    knots = fit_fir(windows, masses, 24, ridge=1e-6)

    # A percent in the length is a percent in the relative frequency.
    for count, left in ((192, 0.002), (191, 0.02), (194, 0.02)):
        others = _lines(80, count, frequency, 2, masses, amplitude)
        assert fir_estimate(others, knots) == pytest.approx(masses, abs=left * amplitude)


def test_windows_of_different_lengths_are_fitted_together():
    masses = np.full(60, 0.1)
    windows = [
        _lines(1, 95 + index % 3, 25.0, index, masses[:1])[0] for index in range(len(masses))
    ]

    knots = fit_fir(windows, masses, 24, ridge=1e-4)

    assert fir_estimate(_lines(50, 96, 25.0, 99, masses[:50]), knots) == pytest.approx(
        masses[:50], abs=0.02 * 0.01
    )


def test_in_the_end_the_weights_slope_to_where_it_is_quiet():
    # Straight, though not level: the vibration dies away during the window.
    masses = np.full(400, 0.1)
    noise = np.random.default_rng(6).standard_normal((400, 64)) * np.linspace(1, 0.1, 64)

    weights = fir_weights(fit_fir(masses[:, None] + 1e-3 * noise, masses, 16, ridge=1e8), 64)

    assert np.diff(weights) == pytest.approx(np.full(63, weights[1] - weights[0]), rel=1e-3)
    assert weights[-1] > 3 * weights[0]


def test_a_heavier_load_under_the_same_vibration_changes_no_weight():
    # Also where the lengths differ, and with them what the knots see of the load.
    rng = np.random.default_rng(9)
    masses = np.repeat([0.1, 0.2, 0.3, 0.4], 20)
    windows = [
        mass + 1e-3 * rng.standard_normal(40 + index % 7) for index, mass in enumerate(masses)
    ]

    knots = fit_fir([window + 5 for window in windows], masses + 5, 16, ridge=1e-3)

    assert knots == pytest.approx(fit_fir(windows, masses, 16, ridge=1e-3), rel=1e-6)


@given(st.floats(1e-6, 1e6))
def test_the_fit_has_no_unit(gain):
    rng = np.random.default_rng(5)
    masses = np.repeat([0.1, 0.2], 15)
    windows = masses[:, None] + 1e-3 * rng.standard_normal((30, 48))
    knots = fit_fir(gain * windows, gain * masses, 12, ridge=1e-3)
    assert knots == pytest.approx(fit_fir(windows, masses, 12, ridge=1e-3), rel=1e-7)


def test_passes_without_any_error_give_a_plain_average():
    masses = np.array([0.1, 0.2, 0.3])
    knots = fit_fir(masses[:, None] * np.ones(64), masses, 8, ridge=1e-3)
    assert fir_estimate(np.full(60, 0.5), knots) == pytest.approx(0.5, rel=1e-9)


def test_weights_without_a_sum_are_refused():
    with pytest.raises(ValueError, match='the sum of the weights'):
        fir_weights(np.array([1.0, -1.0]), 10)

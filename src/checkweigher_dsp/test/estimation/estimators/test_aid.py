# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Adaptive identification against platforms of known theory, numpy's least squares and scipy."""

from dataclasses import astuple
import math
import warnings

from hypothesis import given
from hypothesis import strategies as st
from known_models import RATE, coefficients
import numpy as np
import pytest
from scipy import signal

from checkweigher_dsp.estimation.estimators.aid import (
    LEAST_SAMPLES,
    AdaptiveIdentification,
    AdaptiveSettings,
    hann_lowpass,
    identify_adaptive,
    prefilter,
    prefilter_adaptively,
)
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.extended_kalman import platform_poles

ROUNDING = 1e-9
PLATFORMS = [(22.0, 0.06), (38.0, 0.06), (60.0, 0.2)]  # Hz, damping ratio
RESONANT = (-1.5, 0.9)
COLOUR = 0.5
INDEX = np.arange(96.0)
PLAIN = AdaptiveSettings(iterations=1)
ADAPTIVE = AdaptiveSettings(iterations=4, max_order=3)
SETTINGS = [PLAIN, ADAPTIVE, AdaptiveSettings(3, 6, 100.0)]


def _ringing(frequency, damping, count, mass=0.2, amplitude=0.05):
    """Return a load on a platform that still rings, from the middle of its oscillation."""
    k = np.arange(count)
    step = 2 * math.pi * frequency / RATE
    damped = step * math.sqrt(1 - damping**2)
    return mass * (1 + amplitude * np.exp(-damping * step * k) * np.cos(damped * k + 1))


def _driven(coefficients, noise, mass=0.2):
    """x(k) = -a1 x(k-1) - a2 x(k-2) + b1 + n(k) in its steady state."""
    a1, a2 = coefficients
    return mass + signal.lfilter([1.0], [1, a1, a2], noise, axis=-1)[..., 300:]


def _coloured(seed, shape):
    """First-order autoregressive noise, the correlation of its neighbours being COLOUR."""
    rows, count = shape
    white = np.random.default_rng(seed).standard_normal((rows, count + 300))
    return signal.lfilter([1e-4], [1, -COLOUR], white, axis=-1)


def _identify(samples, settings):
    """Identify one window; all results are numbers."""
    found = identify_adaptive(samples[np.newaxis], settings, RATE)
    return AdaptiveIdentification(*(value[0] for value in astuple(found)))


@pytest.mark.parametrize('settings', SETTINGS)
@pytest.mark.parametrize(('frequency', 'damping'), PLATFORMS)
def test_a_platform_that_only_rings_is_identified_exactly(frequency, damping, settings):
    a1, a2 = coefficients(frequency, damping)

    result = _identify(_ringing(frequency, damping, 96), settings)

    assert result.stable
    assert result.gain == pytest.approx(0.2, rel=ROUNDING)
    assert (result.a1, result.a2) == pytest.approx((a1, a2), rel=1e-6)
    assert result.b1 == pytest.approx(0.2 * (1 + a1 + a2), rel=1e-6)
    assert platform_poles(result.a1, result.a2, RATE) == pytest.approx(
        (frequency, damping), rel=1e-6
    )


@pytest.mark.parametrize('settings', SETTINGS)
def test_a_constant_load_is_shown_as_it_is(settings):
    result = identify_adaptive(np.full((2, 64), 0.2), settings, RATE)
    assert result.gain == pytest.approx([0.2, 0.2], rel=ROUNDING)
    assert result.variance == pytest.approx([0, 0], abs=ROUNDING**2)


@given(st.integers(0, 2**32 - 1), st.integers(LEAST_SAMPLES, 200))
def test_without_a_prefilter_it_is_the_least_squares_of_numpy(seed, count):
    x = 0.2 + 0.01 * np.random.default_rng(seed).standard_normal(count)
    regressors = np.stack([-x[1:-1], -x[:-2], np.ones(count - 2)], axis=1)
    (a1, a2, b1), squares, *_ = np.linalg.lstsq(regressors, x[2:], rcond=None)
    covariance = squares[0] / (count - 5) * np.linalg.inv(regressors.T @ regressors)
    mass = b1 / (1 + a1 + a2)
    slope = np.array([-mass, -mass, 1]) / (1 + a1 + a2)

    result = _identify(x, PLAIN)

    stable = bool(np.all(np.abs(np.roots([1, a1, a2])) < 1))
    assert bool(result.stable) == stable
    if stable:
        assert (result.a1, result.a2, result.b1) == pytest.approx((a1, a2, b1), rel=1e-7)
        assert result.gain == pytest.approx(mass, rel=ROUNDING)
        assert result.variance == pytest.approx(slope @ covariance @ slope, rel=1e-5)


@given(
    st.integers(0, 2**32 - 1),
    st.floats(-1e6, 1e6).filter(lambda gain: abs(gain) > 1e-6),
    st.sampled_from(SETTINGS),
)
def test_another_gain_scales_the_mass_and_nothing_else(seed, gain, settings):
    samples = _ringing(38.0, 0.06, 77) + 2e-4 * np.random.default_rng(seed).standard_normal(77)

    first = _identify(samples, settings)
    scaled = _identify(gain * samples, settings)

    assert scaled.gain == pytest.approx(gain * first.gain, rel=ROUNDING)
    assert scaled.b1 == pytest.approx(gain * first.b1, rel=1e-6)
    assert scaled.variance == pytest.approx(gain * gain * first.variance, rel=1e-6)
    assert (scaled.a1, scaled.a2) == pytest.approx((first.a1, first.a2), rel=1e-6)
    assert scaled.stable == first.stable


def test_the_noise_is_white_behind_the_prefilter():
    # Over 50 windows of 400 the correlation of neighbours has a standard deviation of 0.007.
    samples = _driven(RESONANT, _coloured(12, (50, 400)))

    def neighbours(settings):
        x = prefilter_adaptively(samples, settings, RATE)[0] - 1
        # What the true platform does not explain is noise.
        noise = x[:, 2:] + RESONANT[0] * x[:, 1:-1] + RESONANT[1] * x[:, :-2]
        return np.mean(noise[:, 1:] * noise[:, :-1]) / np.mean(noise * noise)

    assert neighbours(PLAIN) == pytest.approx(COLOUR, abs=0.03)
    assert abs(neighbours(AdaptiveSettings(8, 3))) < 0.03


@pytest.mark.parametrize('settings', [PLAIN, AdaptiveSettings(3, 0)])
@pytest.mark.parametrize(
    'growth',
    [1.02**INDEX * np.cos(0.3 * INDEX), 1.02**INDEX + 0.7**INDEX, (-1.02) ** INDEX + 0.7**INDEX],
    ids=['outside as a pair', 'beyond 1', 'beyond -1'],
)
def test_poles_outside_the_circle_fall_back_to_the_hann_mean_and_are_flagged(growth, settings):
    growing = 0.2 + 1e-3 * growth

    result = identify_adaptive(np.stack([growing, _ringing(38.0, 0.06, 96)]), settings, RATE)

    assert result.stable.tolist() == [False, True]
    assert result.gain == pytest.approx([hann_mean(growing), 0.2], rel=ROUNDING)
    assert (result.a1[0], result.a2[0]) == (0, 0)
    assert result.variance[0] == pytest.approx(np.var(growing))


def test_an_unstable_iteration_keeps_what_the_stable_one_before_it_found():
    rng = np.random.default_rng(14)
    slow = 0.2 + 0.01 * np.cos(0.1 * np.arange(48) + 1)
    windows = slow + 1e-4 * rng.standard_normal((400, 48))
    found = [identify_adaptive(windows, AdaptiveSettings(count, 4), RATE) for count in (1, 2)]

    lost = found[0].stable & ~found[1].stable

    assert lost.any()
    assert found[1].gain[lost] == pytest.approx(found[0].gain[lost], rel=ROUNDING)
    assert found[1].a1[lost] == pytest.approx(found[0].a1[lost], rel=ROUNDING)


@pytest.mark.parametrize('level', [0.0, math.nan, math.inf])
def test_a_window_without_a_level_has_no_mass_and_harms_no_other(level):
    windows = np.stack([np.full(64, level), _ringing(38.0, 0.06, 64)])

    with warnings.catch_warnings():
        warnings.simplefilter('error')
        result = identify_adaptive(windows, ADAPTIVE, RATE)

    assert math.isnan(result.gain[0])
    assert not result.stable[0]
    assert result.gain[1] == pytest.approx(0.2, rel=ROUNDING)


def test_the_prefiltered_input_stays_one_and_the_level_that_of_the_load():
    windows = np.array([[0.1], [0.2], [0.3]])
    windows = windows + 1e-4 * np.random.default_rng(15).standard_normal((3, 96))

    samples, scale, noise = prefilter_adaptively(windows, AdaptiveSettings(3, 4, 100.0), RATE)

    # A low-pass of 0.7203 * 960 / 100 - 1 taps and an autoregression of order 4.
    assert samples.shape == (3, 96 - 5 - 4)
    assert samples.mean(axis=-1) == pytest.approx(np.ones(3), abs=1e-3)
    assert scale == pytest.approx(windows.mean(axis=-1), rel=ROUNDING)
    assert np.all(noise > 0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_the_prefilter_is_a_convolution_within_the_window(seed, count):
    rng = np.random.default_rng(seed)
    samples, taps = rng.standard_normal((2, 40)), rng.standard_normal((2, count))

    each, one = prefilter(samples, taps), prefilter(samples, taps[0])

    for row in range(2):
        assert each[row] == pytest.approx(np.convolve(samples[row], taps[row], 'valid'), abs=1e-12)
        assert one[row] == pytest.approx(np.convolve(samples[row], taps[0], 'valid'), abs=1e-12)


@pytest.mark.parametrize('cutoff', [5.0, 20.0])
def test_the_lowpass_is_down_by_three_decibels_at_its_cutoff(cutoff):
    taps = hann_lowpass(cutoff, RATE)
    _, response = signal.freqz(taps, worN=[cutoff], fs=RATE)
    assert taps.sum() == pytest.approx(1)
    assert 20 * math.log10(abs(response[0])) == pytest.approx(-3.01, abs=0.1)


@pytest.mark.parametrize('cutoff', [0.36 * RATE, 0.5 * RATE, math.inf])
def test_from_a_third_of_the_sample_rate_on_there_is_no_lowpass(cutoff):
    assert hann_lowpass(cutoff, RATE).tolist() == [1.0]


def test_a_lowpass_longer_than_half_the_window_is_cut_to_it():
    settings = AdaptiveSettings(1, 0, 0.1)
    assert prefilter_adaptively(np.full((1, 20), 0.1), settings, RATE)[0].shape == (1, 20 - 10 + 1)

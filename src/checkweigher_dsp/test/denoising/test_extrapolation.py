# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Extrapolation of lines, which are known, and of noise, which is not."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.denoising.extrapolation import block_means
from checkweigher_dsp.denoising.extrapolation import extrapolate as extrapolate_all
from checkweigher_dsp.denoising.extrapolation import predict as predict_all
from checkweigher_dsp.signal.autoregression import burg

RATE = 960.0


def _line(first, count, frequency=10.0, phase=0.3):
    return np.sin(2 * np.pi * frequency * (first + np.arange(count)) / RATE + phase)


def extrapolate(signal, *args, **options):
    """Extrapolate one signal."""
    extrapolated, taps = extrapolate_all(signal[np.newaxis], *args, **options)
    return extrapolated[0], taps[0]


def predict(signals, taps, count):
    """Predict signals of one model."""
    return predict_all(signals[np.newaxis], taps[np.newaxis], count)[0]


# The model is made of block means and its line drawn between block centres: at 10 Hz of 240 that
# alone is off by 1 - cos(pi / 24), 1 %, at the middle between two.
@pytest.mark.parametrize(
    ('frequency', 'phase', 'order', 'error'), [(10.0, 0.3, 8, 0.05), (22.0, 1.0, 16, 0.1)]
)
def test_a_line_goes_on_before_and_after(frequency, phase, order, error):
    signal = _line(0, 384, frequency, phase)
    result, _ = extrapolate(signal, 100, 120, order=order, block=4)
    np.testing.assert_array_equal(result[100:484], signal)
    np.testing.assert_allclose(result, _line(-100, 604, frequency, phase), atol=error)


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_a_continuation_does_not_grow(seed, order):
    noise = np.random.default_rng(seed).standard_normal(400)
    result, _ = extrapolate(noise, 0, 4000, order, 4)
    assert np.abs(result[-1000:]).max() <= np.abs(noise).max()


@pytest.mark.parametrize(('count', 'order'), [(400, 0), (11, 25), (1, 25)])
def test_without_a_model_nothing_goes_on(count, order):
    signal = np.ones(count)
    result, taps = extrapolate(signal, 3, 2, order, 4)
    np.testing.assert_array_equal(result, np.r_[np.zeros(3), signal, np.zeros(2)])
    np.testing.assert_array_equal(taps, [1.0])


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 300))
def test_prediction_agrees_with_the_recursion_sample_by_sample(seed, order, count):
    signals = np.random.default_rng(seed).standard_normal((2, 3 * order + 3))
    taps = burg(signals[0], order)[0]
    expected = np.concatenate([signals, np.zeros((2, count))], axis=-1)
    for k in range(signals.shape[-1], expected.shape[-1]):
        expected[:, k] = -np.sum(taps[1:] * expected[:, k - order : k][:, ::-1], axis=-1)

    result = predict(signals, taps, count)

    np.testing.assert_allclose(result, expected[:, -count:], rtol=0, atol=1e-10)


def test_lines_are_predicted_as_exact_arithmetic_does():
    # Eight poles close to the circle: an impulse makes this model swing to a million, and rounding
    # with it. The straight lines between block centres are off by 1e-2 of the signal anyway.
    signal = block_means(_line(0, 384), 4)
    taps = burg(signal, 8)[0]
    exact = [Fraction(value) for value in signal.tolist()]
    for _ in range(60):
        exact.append(
            -sum(Fraction(tap) * x for tap, x in zip(taps[1:].tolist(), exact[:-9:-1], strict=True))
        )

    (result,) = predict(signal[None], taps, 60)

    np.testing.assert_allclose(result, [float(value) for value in exact[-60:]], atol=1e-4)

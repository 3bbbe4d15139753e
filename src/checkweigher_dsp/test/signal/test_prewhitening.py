# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Prewhitening against the covariance of the noise that it is made for."""

import math

from known_models import covariance
import numpy as np
import pytest
from scipy.signal import lfilter

from checkweigher_dsp.signal.autoregression import burg
from checkweigher_dsp.signal.prewhitening import Prewhitener, pooled_reflections

EXACT = 1e-10
# Roots of radius 0.9 and 0.5, and one of 0.7.
MODEL = np.poly([0.9 * np.exp(0.4j), 0.9 * np.exp(-0.4j), 0.5j, -0.5j, -0.7]).real


def _reflections(coefficients):
    """Step an autoregression [1, c1, ...] down to its reflection coefficients."""
    found, c = [], np.asarray(coefficients, float)
    while len(c) > 1:
        k = c[-1]
        found.append(k)
        c = ((c - k * c[::-1]) / (1 - k * k))[:-1]
    return found[::-1]


def _matrix(whitener, count):
    return whitener.whiten(np.eye(count)).T


@pytest.mark.parametrize('count', [1, 2, 4, 5, 6, 40])
def test_the_filter_is_the_inverse_cholesky_factor_of_the_covariance(count):
    known = covariance(MODEL, 3.0, count)

    matrix = _matrix(Prewhitener(_reflections(MODEL), 3.0), count)

    np.testing.assert_allclose(matrix @ known @ matrix.T, np.eye(count), atol=EXACT)
    np.testing.assert_allclose(matrix, np.linalg.inv(np.linalg.cholesky(known)), atol=EXACT)


def test_many_signals_at_once_are_whitened_as_each_alone():
    signals = np.random.default_rng(2).standard_normal((4, 3, 25))
    whitener = Prewhitener(_reflections(MODEL), 0.5)
    together = whitener.whiten(signals)
    for place in np.ndindex(4, 3):
        np.testing.assert_allclose(together[place], whitener.whiten(signals[place]), rtol=EXACT)


def test_one_segment_is_fitted_as_by_burg():
    segment = lfilter([1.0], MODEL, np.random.default_rng(3).standard_normal(200))
    reflections, std_dev = pooled_reflections([segment], 6)
    _, expected = burg(segment, 6)
    np.testing.assert_allclose(reflections, expected, rtol=EXACT)
    assert std_dev**2 == pytest.approx(np.mean(segment**2) * np.prod(1 - expected**2), rel=EXACT)


def test_a_known_model_is_recovered_from_many_short_segments():
    # x(k) = 1.5 x(k-1) - 0.8 x(k-2) + w: reflections -1.5 / 1.8 and 0.8.
    noise = np.random.default_rng(4)
    count, length = 400, 30
    segments = [
        lfilter([1.0], [1.0, -1.5, 0.8], 0.3 * noise.standard_normal(300))[-length - n % 3 :]
        for n in range(count)
    ]

    reflections, std_dev = pooled_reflections(segments, 2)

    # Four standard deviations of an estimate from N samples, sqrt((1 - k^2) / N) and less for the
    # first, whose bound is that of the second to be on the safe side; Burg's bias is within.
    bound = 4 * math.sqrt((1 - 0.8**2) / (count * length))
    assert reflections == pytest.approx([-1.5 / 1.8, 0.8], abs=bound)
    assert std_dev == pytest.approx(0.3, rel=4 / math.sqrt(2 * count * length) + bound)


def test_segments_of_equal_length_in_any_order_give_the_same():
    segments = list(np.random.default_rng(5).standard_normal((6, 20)))
    segments[2] = segments[2][:11]

    once, std_dev = pooled_reflections(segments, 3)
    again, std_dev_again = pooled_reflections(segments[::-1], 3)

    np.testing.assert_allclose(again, once, rtol=1e-12)
    assert std_dev_again == pytest.approx(std_dev, rel=1e-12)
    assert np.all(np.abs(once) < 1)


@pytest.mark.parametrize('segments', [[], [np.ones(5)], [np.ones(2), np.ones(5)]])
def test_segments_that_are_all_too_short_are_refused(segments):
    with pytest.raises(ValueError, match='no segment of noise is longer than 5 samples'):
        pooled_reflections(segments, 5)


@pytest.mark.parametrize('value', [0.0, math.nan])
def test_stretches_without_noise_are_refused(value):
    with pytest.raises(ValueError, match='the segments contain no noise'):
        pooled_reflections([np.full(20, value)], 2)

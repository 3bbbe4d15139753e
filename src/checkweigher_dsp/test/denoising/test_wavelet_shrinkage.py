# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Shrinkage by FFT against PyWavelets, which does the same with the full transform."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import plain_path
import pytest
import pywt

from checkweigher_dsp.denoising.wavelet_shrinkage import (
    Shrinkage,
    band_responses,
    denoise_periodic,
    shrink,
    threshold_universally,
)

ROUNDING = 1e-10  # of the largest sample

LENGTHS = st.integers(1, 32).map(lambda periods: 128 * periods)
SHRINKAGES = st.none() | st.builds(Shrinkage, st.floats(0, 2), st.floats(0, 3))


@given(LENGTHS, st.lists(SHRINKAGES, min_size=7, max_size=7), st.integers(0, 2**32 - 1))
def test_db16_of_7_levels_agrees_with_pywavelets(length, details, seed):
    noise = np.random.default_rng(seed).standard_normal(length)
    np.testing.assert_allclose(
        denoise_periodic(noise, details),
        plain_path.denoise_periodic(noise, details),
        rtol=0,
        atol=ROUNDING * np.abs(noise).max(),
    )


@pytest.mark.parametrize(
    ('gain', 'threshold', 'expected'),
    [
        (0.5, 2.0, [-1.5, 0.0, 0.0, 0.0, 0.0, 0.5]),
        (0.0, 1.0, [0.0] * 6),
        (1.0, 0.0, [-5.0, -2.0, 0.0, 1.5, 2.0, 3.0]),
    ],
)
def test_shrink_subtracts_the_threshold_and_applies_the_gain(gain, threshold, expected):
    coefficients = np.array([-5.0, -2.0, 0.0, 1.5, 2.0, 3.0])
    np.testing.assert_array_equal(shrink(coefficients, Shrinkage(gain, threshold)), expected)


def test_the_responses_that_are_shared_cannot_be_changed():
    with pytest.raises(ValueError, match='read-only'):
        band_responses(128)[0, 0] = 1.0


def _threshold_by_pywt(stretch, mode, measured, each_level):
    approximation, *bands = pywt.swt(stretch, 'db16', level=7, trim_approx=True, norm=False)
    factor = np.sqrt(2 * np.log(len(stretch[measured]))) / 0.6745
    finest = np.median(np.abs(bands[-1][measured]))
    kept = [
        pywt.threshold(
            band, factor * (np.median(np.abs(band[measured])) if each_level else finest), mode
        )
        for band in bands
    ]
    return pywt.iswt([approximation, *kept], 'db16', norm=False)


@pytest.mark.parametrize('mode', ['hard', 'soft'])
@pytest.mark.parametrize('each_level', [False, True])
@pytest.mark.parametrize('measured', [slice(None), slice(100, 300)])
def test_universal_thresholds_agree_with_pywavelets(mode, each_level, measured):
    random = np.random.default_rng(4)
    stretch = 5 + np.cumsum(random.standard_normal(512)) + random.standard_normal(512)

    result = threshold_universally(
        stretch, hard=mode == 'hard', measured=measured, each_level=each_level
    )

    np.testing.assert_allclose(
        result,
        _threshold_by_pywt(stretch, mode, measured, each_level),
        rtol=0,
        atol=ROUNDING * np.abs(stretch).max(),
    )

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Identification of denoised passes against least squares and filterpy, alone and in batches."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import plain_path
import pytest

from checkweigher_dsp.estimation.estimators.iswd_eksi import IswdEksiParameters, identify_passes
from checkweigher_dsp.signal.extended_kalman import Noise

ROUNDING = 1e-10
NOISE = IswdEksiParameters().noise


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(16, 200),
    st.floats(0.05, 0.9),
    st.builds(
        Noise, st.floats(1e-3, 10.0), st.floats(0.0, 1.0), st.floats(1e-8, 1e-2),
        st.floats(0.01, 10.0),
    ),
    st.floats(1.0, 1e3),
)  # fmt: skip
def test_windows_agree_with_filterpy(seed, count, share, noise, rise):
    random = np.random.default_rng(seed)
    loads = np.minimum(np.arange(1, count + 1) / (share * count), 1.0)
    samples = 0.2 * loads + 0.01 * random.standard_normal(count)

    found = identify_passes([(samples, loads)], np.array([1e-4]), noise, rise)

    expected = plain_path.identify_window(samples, 1e-4, loads, noise, rise)
    assert (found.gain[0], found.variance[0]) == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize('samples', [np.zeros(20), np.full(20, math.nan), np.full(20, math.inf)])
def test_a_window_without_a_level_has_no_gain(samples):
    assert math.isnan(identify_passes([(samples, np.ones(20))], np.zeros(1), NOISE, 10.0).gain[0])

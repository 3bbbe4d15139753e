# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The morphological filter against SciPy, and the low-pass before it against that of TVLPF."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.ndimage import grey_closing, grey_opening

from checkweigher_dsp.estimation.estimators.tvlp_mf import lowpass_matrix, morphological
from checkweigher_dsp.estimation.estimators.tvlpf import lowpass_weights


@given(st.integers(1, 80), st.integers(0, 45), st.integers(0, 2**32 - 1))
def test_the_morphological_filter_is_that_of_scipy(count, half, seed):
    signal = np.random.default_rng(seed).standard_normal(count)
    element = 2 * half + 1
    how = {'size': element, 'mode': 'nearest'}
    opened, closed = grey_opening(signal, **how), grey_closing(signal, **how)
    expected = (grey_closing(opened, **how) + grey_opening(closed, **how)) / 2
    assert morphological(signal, element).tolist() == expected.tolist()


@pytest.mark.parametrize('sections', [1, 2, 4])
def test_each_output_of_the_low_pass_is_that_of_tvlpf_on_the_samples_so_far(sections):
    schedule = sections, 50.0, 3.0, 0.97, 960.0
    for row, weights in enumerate(lowpass_matrix(64, *schedule)):
        expected = np.zeros(64)
        expected[: row + 1] = lowpass_weights(row + 1, *schedule)
        assert weights == pytest.approx(expected, abs=1e-14)

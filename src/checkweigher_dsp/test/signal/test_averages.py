# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Hann-weighted mean against numbers worked by hand."""

import numpy as np
import pytest

from checkweigher_dsp.signal.averages import hann_mean

ROUNDING = 1e-14


def test_hann_mean_weights_by_the_raised_cosine_without_its_zeros():
    # sin^2(pi k / 4) for k = 1, 2, 3 is 1/2, 1, 1/2.
    assert hann_mean(np.array([2.0, 4.0, 10.0])) == pytest.approx((1 + 4 + 5) / 2, rel=ROUNDING)
    assert hann_mean(np.array([3.0])) == pytest.approx(3.0, rel=ROUNDING)
    assert isinstance(hann_mean(np.array([1.0, 2.0])), float)


def test_a_line_of_any_phase_nearly_vanishes():
    # A Hann window of duration T is below 2.7 % (its first side lobe) from a frequency of 2 / T on.
    k = np.arange(96)
    uneven = np.cos(2 * np.pi * 2.4 / 96 * k + 1)

    assert abs(hann_mean(uneven)) < 0.027
    assert abs(np.mean(uneven)) > 0.027

"""The Hann-weighted mean against numbers worked by hand."""

import numpy as np
import pytest

from checkweigher_dsp.averaging import hann_mean

ROUNDING = 1e-14


def test_hann_mean_weights_by_the_raised_cosine_without_its_zeros():
    # sin^2(pi k / 4) for k = 1, 2, 3 is 1/2, 1, 1/2.
    assert hann_mean(np.array([2.0, 4.0, 10.0])) == pytest.approx((1 + 4 + 5) / 2, rel=ROUNDING)


def test_hann_mean_of_one_sample_is_the_sample():
    assert hann_mean(np.array([3.0])) == pytest.approx(3.0, rel=ROUNDING)

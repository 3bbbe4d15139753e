"""The means against numbers worked by hand."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.signal.averages import hann_mean, mean, median, variance, window_mean

ROUNDING = 1e-14


def test_hann_mean_weights_by_the_raised_cosine_without_its_zeros():
    # sin^2(pi k / 4) for k = 1, 2, 3 is 1/2, 1, 1/2.
    assert hann_mean(np.array([2.0, 4.0, 10.0])) == pytest.approx((1 + 4 + 5) / 2, rel=ROUNDING)


def test_hann_mean_of_one_sample_is_the_sample():
    assert hann_mean(np.array([3.0])) == pytest.approx(3.0, rel=ROUNDING)


def test_window_mean_weighs_all_samples_alike():
    assert window_mean(np.array([2.0, 4.0, 9.0])) == pytest.approx(5.0, rel=ROUNDING)


@pytest.mark.parametrize('mean', [window_mean, hann_mean])
def test_the_mean_of_one_window_is_a_float(mean):
    assert isinstance(mean(np.array([1.0, 2.0])), float)


@pytest.mark.parametrize('mean', [window_mean, hann_mean])
@given(st.integers(0, 2**32 - 1), st.integers(1, 200))
def test_windows_are_averaged_one_by_one(mean, seed, count):
    windows = np.random.default_rng(seed).standard_normal((3, 2, count))

    result = mean(windows)

    assert result.shape == (3, 2)
    for index in np.ndindex(3, 2):
        assert result[index] == pytest.approx(mean(windows[index]), abs=ROUNDING)


def test_the_plain_mean_leaves_nothing_of_whole_periods_and_hann_little_of_any():
    # A Hann window of duration T is below 2.7 % (its first side lobe) from a frequency of 2 / T on.
    k = np.arange(96)
    whole = np.cos(2 * np.pi * 3 / 96 * k + 1)
    uneven = np.cos(2 * np.pi * 2.4 / 96 * k + 1)

    assert window_mean(whole) == pytest.approx(0, abs=ROUNDING)
    assert abs(hann_mean(uneven)) < 0.027
    assert abs(window_mean(uneven)) > 0.027


@pytest.mark.parametrize(
    ('own', 'of_numpy'), [(mean, np.mean), (median, np.median), (variance, np.var)]
)
@given(values=st.lists(st.floats(width=64), min_size=1, max_size=40))
def test_what_is_faster_than_numpy_has_the_same_bits(own, of_numpy, values):
    with np.errstate(all='ignore'):
        assert repr(own(np.array(values))) == repr(float(of_numpy(np.array(values))))


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=1, max_size=300))
def test_the_mean_of_counts_is_that_of_numpy(values):
    counts = np.array(values, np.int32)
    assert mean(counts) == np.mean(counts)

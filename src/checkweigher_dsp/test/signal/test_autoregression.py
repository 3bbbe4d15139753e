# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Burg's method against worked numbers and known processes."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import plain_path
import pytest

from checkweigher_dsp.signal.autoregression import akaike_order, burg

ROUNDING = 1e-10


def test_burg_gives_the_numbers_worked_by_hand():
    # k1 = -2 (1 2 + 2 3) / (1 + 4 + 4 + 9); then f = 11/9 and b = -7/9 are left,
    # k2 = 2 * 11 * 7 / (121 + 49).
    first, second = -8 / 9, 77 / 85

    coefficients, reflections = burg(np.array([1.0, 2.0, 3.0]), 2)

    assert reflections == pytest.approx([first, second], rel=ROUNDING)
    assert coefficients == pytest.approx([1, first + second * first, second], rel=ROUNDING)


@given(st.integers(0, 2**32 - 1), st.integers(3, 60), st.data())
def test_every_model_of_burg_is_stable(seed, count, data):
    order = data.draw(st.integers(1, count - 1))
    rng = np.random.default_rng(seed)
    signal = rng.standard_normal(count) + rng.uniform(0, 10) * np.cos(rng.uniform(0, 3, 1) * count)

    _, reflections = burg(signal, order)

    assert np.all(np.abs(reflections) <= 1 + ROUNDING)
    assert np.all(np.abs(np.roots(burg(signal, min(order, 8))[0])) <= 1 + 1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(3, 150), st.data())
def test_the_model_of_one_order_is_that_of_the_plain_recursion(seed, count, data):
    order = data.draw(st.integers(0, count // 3))
    signal = np.random.default_rng(seed).standard_normal(count).cumsum()
    coefficients, _ = burg(signal, order)
    np.testing.assert_allclose(coefficients, plain_path.burg(signal, order), rtol=0, atol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_lines_with_next_to_no_noise_have_the_model_of_the_plain_recursion(seed):
    # The energy falls by eight digits, so it has to be summed again on the way.
    random, time = np.random.default_rng(seed), np.arange(150)
    lines = [np.cos(f * time + random.uniform(0, 6)) for f in (0.3, 0.9, 2.0)]
    signal = sum(lines) + 1e-4 * random.standard_normal(150)

    coefficients, _ = burg(signal, 20)

    np.testing.assert_allclose(coefficients, plain_path.burg(signal, 20), rtol=0, atol=1e-8)


@given(st.integers(0, 2**32 - 1), st.integers(0, 6))
def test_the_taps_of_a_model_sum_to_the_product_of_one_plus_its_reflections(seed, order):
    coefficients, reflections = burg(np.random.default_rng(seed).standard_normal(40), order)
    assert coefficients.sum() == pytest.approx(np.prod(1 + reflections), rel=1e-6, abs=ROUNDING)


@given(st.integers(0, 2**32 - 1), st.integers(0, 6))
def test_a_lower_order_has_the_first_reflections_of_a_higher_one(seed, order):
    signal = np.random.default_rng(seed).standard_normal(40)
    np.testing.assert_array_equal(burg(signal, order)[1], burg(signal, 6)[1][:order])


def test_burg_leaves_a_signal_of_zeros_as_it_is():
    coefficients, reflections = burg(np.zeros(10), 3)
    assert coefficients == pytest.approx([1, 0, 0, 0])
    assert reflections == pytest.approx(np.zeros(3))
    assert akaike_order(np.zeros(4), 10) == 0


def test_the_order_is_worth_two_for_each_coefficient():
    # n ln(power): a step from 1 to exp(-0.025) is worth 2.5 for 100 samples, 1.25 for 50.
    powers = np.array([4.0, 1.0, math.exp(-0.025), math.exp(-0.025)])
    assert akaike_order(powers, 100) == 2
    assert akaike_order(powers, 50) == 1

"""Burg's method against worked numbers and known processes."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import plain_path
import pytest
from scipy.signal import lfilter

from checkweigher_dsp.signal.autoregression import akaike_order, burg, burg_model

ROUNDING = 1e-10
PROCESS = [1.0, -0.75, 0.5]  # stable, its poles have the modulus sqrt(1/2)
ONE_PERCENT_TAIL = 2.6  # standard deviations


def _process(count, seed, coefficients=PROCESS):
    noise = np.random.default_rng(seed).standard_normal(count + 200)
    return lfilter([1.0], coefficients, noise)[200:]


def test_burg_gives_the_numbers_worked_by_hand():
    # k1 = -2 (1 2 + 2 3) / (1 + 4 + 4 + 9); then f = 11/9 and b = -7/9 are left,
    # k2 = 2 * 11 * 7 / (121 + 49).
    first, second = -8 / 9, 77 / 85

    models = burg(np.array([1.0, 2.0, 3.0]), 2)

    assert models.reflections == pytest.approx([first, second], rel=ROUNDING)
    assert models.coefficients == pytest.approx(
        np.array([[1, 0, 0], [1, first, 0], [1, first + second * first, second]]), rel=ROUNDING
    )
    assert models.powers == pytest.approx(
        [14 / 3, 14 / 3 * (1 - first**2), 14 / 3 * (1 - first**2) * (1 - second**2)], rel=ROUNDING
    )


@pytest.mark.parametrize('order', [2, 5])
def test_burg_finds_a_textbook_process(order):
    # Each coefficient of an AR fit to n samples has a standard deviation of at most 1 / sqrt(n).
    count = 40_000

    models = burg(_process(count, 3), order)

    assert models.coefficients[order] == pytest.approx(
        PROCESS + [0.0] * (order - 2), abs=4 / math.sqrt(count)
    )
    assert models.powers[order] == pytest.approx(1, abs=4 * math.sqrt(2 / count))


@given(st.integers(0, 2**32 - 1), st.integers(3, 60), st.data())
def test_every_model_of_burg_is_stable(seed, count, data):
    order = data.draw(st.integers(1, count - 1))
    rng = np.random.default_rng(seed)
    signal = rng.standard_normal(count) + rng.uniform(0, 10) * np.cos(rng.uniform(0, 3, 1) * count)

    models = burg(signal, order)

    assert np.all(np.abs(models.reflections) <= 1 + ROUNDING)
    assert np.all(np.diff(models.powers) <= ROUNDING * models.powers[0])
    assert np.all(np.abs(np.roots(models.coefficients[min(order, 8)])) <= 1 + 1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(3, 150), st.data())
def test_the_model_of_one_order_is_that_of_the_plain_recursion(seed, count, data):
    order = data.draw(st.integers(0, count // 3))
    signals = np.random.default_rng(seed).standard_normal((3, count)).cumsum(axis=-1)

    coefficients, reflections = burg_model(signals, order)

    for signal, row, own in zip(signals, coefficients, reflections, strict=True):
        np.testing.assert_allclose(row, plain_path.burg(signal, order), rtol=0, atol=1e-9)
        alone = burg_model(signal, order)
        np.testing.assert_array_equal(alone[0], row)
        np.testing.assert_array_equal(alone[1], own)


@given(st.integers(0, 2**32 - 1))
def test_lines_of_which_next_to_nothing_is_left_have_the_model_of_the_plain_recursion(seed):
    # The energy falls by eight digits, so it has to be summed anew on the way.
    random, time = np.random.default_rng(seed), np.arange(150)
    lines = [np.cos(f * time + random.uniform(0, 6, (3, 1))) for f in (0.3, 0.9, 2.0)]
    signals = sum(lines) + 1e-4 * random.standard_normal((3, 150))

    coefficients, _ = burg_model(signals, 20)

    for signal, row in zip(signals, coefficients, strict=True):
        np.testing.assert_allclose(row, plain_path.burg(signal, 20), rtol=0, atol=1e-8)
        np.testing.assert_array_equal(burg_model(signal, 20)[0], row)


@given(st.integers(0, 2**32 - 1))
def test_the_taps_of_a_model_sum_to_the_product_of_one_plus_its_reflections(seed):
    models = burg(np.random.default_rng(seed).standard_normal(40), 6)

    assert models.coefficients.sum(axis=-1)[1:] == pytest.approx(
        np.cumprod(1 + models.reflections), rel=1e-6, abs=ROUNDING
    )


def test_burg_takes_signals_one_by_one():
    signals = np.random.default_rng(1).standard_normal((2, 3, 30))

    models = burg(signals, 4)

    assert models.coefficients.shape == (2, 3, 5, 5)
    for index in np.ndindex(2, 3):
        alone = burg(signals[index], 4)
        assert models.coefficients[index] == pytest.approx(alone.coefficients, abs=ROUNDING)
        assert models.powers[index] == pytest.approx(alone.powers, abs=ROUNDING)


def test_burg_leaves_a_signal_of_zeros_as_it_is():
    models = burg(np.zeros(10), 3)

    assert models.coefficients == pytest.approx(np.eye(4, 4)[[0, 0, 0, 0]])
    assert models.powers == pytest.approx(np.zeros(4))
    assert akaike_order(models.powers, 10) == 0


@pytest.mark.parametrize('order', [-1, 10])
def test_burg_refuses_an_order_that_does_not_fit(order):
    with pytest.raises(ValueError, match=f'order {order}'):
        burg(np.ones(10), order)


def test_the_order_is_worth_two_for_each_coefficient():
    # n ln(power): a step from 1 to exp(-0.03) is worth 3 for 100 samples, 1.5 for 50.
    powers = np.array([4.0, 1.0, math.exp(-0.03), math.exp(-0.03)])

    assert akaike_order(powers, 100) == 2
    assert akaike_order(powers, 50) == 1


def test_akaike_seldom_takes_a_process_for_one_of_a_lower_order():
    signals = np.stack([_process(400, seed) for seed in range(50)])
    models = burg(signals, 10)

    orders = akaike_order(models.powers, 400)

    assert orders.shape == (50,)
    assert orders.min() == 2  # 0.5 is ten standard deviations
    assert np.mean(orders == 2) > 0.5  # in the limit 0.71 of all for Akaike's criterion


def test_the_coefficients_of_an_order_are_padded_with_zeros():
    models = burg(np.random.default_rng(2).standard_normal((2, 30)), 3)

    taps = models.of_order(np.array([1, 3]))

    assert taps.shape == (2, 4)
    assert taps[0] == pytest.approx([1, models.reflections[0, 0], 0, 0], rel=ROUNDING)
    assert taps[1] == pytest.approx(models.coefficients[1, 3], rel=ROUNDING)

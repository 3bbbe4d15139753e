# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Gauss-Markov estimate against passes of known make-up and the textbook formula."""

from dataclasses import replace
import math

from known_models import covariance
import numpy as np
import pytest
from scipy.signal import lfilter
from synthetic_line import make_pass

from checkweigher_core.records import seconds
from checkweigher_dsp.estimation.estimators.gauss_markov import (
    GaussMarkov,
    GaussMarkovParameters,
    estimate_untrained,
    least_squares,
)
from checkweigher_dsp.signal.autoregression import burg
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.platform_response import Crossing, Platform, responses

# An oscillation at 20 Hz that dies out, driven by white noise: x(k) + c1 x(k-1) + c2 x(k-2) = w.
DECAY, ANGLE = 0.97, 2 * math.pi * 20 / 960
MODEL = np.array([1.0, -2 * DECAY * math.cos(ANGLE), DECAY**2])
REFLECTIONS = (float(MODEL[1] / (1 + MODEL[2])), float(MODEL[2]))
NOISE = 2e-5  # kg
IMPACT = 0.02  # s/m
ZERO_STD_DEV = 3e-5  # kg
FREE = 1.0  # kg, of the oscillations before
COUNTS_PER_KG = 1e9
TRAINED = GaussMarkovParameters(
    sample_rate=960.0, natural_frequency=38.0, damping_ratio=0.06, moving_mass=2.5,
    impact=(IMPACT,), order=2, reflection=REFLECTIONS, noise=(NOISE,),
)  # fmt: skip
ROUNDING = 1e-8  # of counts of 1e-9 kg on a mass of 0.1 kg and more, relative


def _estimate(window, **changes):
    return GaussMarkov(replace(TRAINED, **changes)).estimate(window)


def _textbook(window, mass, lead_time=0.4):
    """Mass and variance by the full covariance, each prior one more term of rank 1."""
    time = seconds(window.stamp - window.t1) + np.arange(len(window.counts)) / 960.0
    used = time >= -lead_time
    used[: window.empty_begin] = False
    rows = responses(Platform(38.0, 0.06, 2.5), mass, Crossing(0.0, 0.1, 0.2, 0.3), time[used])
    noise = covariance(MODEL, NOISE, np.sum(used)) + ZERO_STD_DEV**2
    for row, std_dev in zip(rows[1:], (FREE, FREE, IMPACT * mass, IMPACT * mass), strict=True):
        noise += std_dev**2 * np.outer(row, row)
    weights = np.linalg.solve(noise, rows[0])
    information = rows[0] @ weights
    return weights @ window.force[used] / information, 1 / information


def _noise(random):
    """Return a disturbance as it is modelled: coloured noise and an error of the zero."""

    def disturb(time):
        steps = NOISE * random.standard_normal(len(time) + 2000)
        return lfilter([1.0], MODEL, steps)[2000:] + ZERO_STD_DEV * random.standard_normal()

    return disturb


@pytest.fixture
def window():
    random = np.random.default_rng(1)
    return make_pass(
        old=(0.003, -0.002), impact=(0.002, 0.001), disturbance=_noise(random),
        zero_std_dev=ZERO_STD_DEV * COUNTS_PER_KG,
    )  # fmt: skip


@pytest.mark.parametrize('mass', [0.0745, 0.2545, 1.5])
@pytest.mark.parametrize('trail', [0.0, 0.05])
def test_a_pass_without_noise_is_recovered_whatever_else_moves_the_belt(mass, trail):
    window = make_pass(
        mass, trail=trail, old=(0.02, -0.01), impact=(0.01, -0.005),
        disturbance=lambda time: 0.0004 + 0 * time, zero_std_dev=0.001 * COUNTS_PER_KG,
    )  # fmt: skip

    # The less noise is reckoned with, the less the priors pull.
    assert _estimate(window, noise=(1e-8,)).mass == pytest.approx(mass, rel=1e-6)


def test_another_platform_than_the_one_learned_is_taken_for_another_mass():
    window = make_pass(platform=Platform(37.0, 0.06, 2.5))
    # 1e9: no signal is so far from the model that it would be no pass.
    assert abs(_estimate(window, max_misfit=1e9).mass - 0.2) > 1e-6 * 0.2
    learned = _estimate(window, max_misfit=1e9, natural_frequency=37.0)
    assert learned.mass == pytest.approx(0.2, rel=ROUNDING)


@pytest.mark.parametrize(('times', 'known'), [(1.0, True), (3.0, True), (5.0, False)])
def test_a_signal_further_from_the_model_than_allowed_has_no_mass(times, known):
    # The misfit is the root mean square in units of the noise, and 4 of it are allowed.
    disturb = _noise(np.random.default_rng(3))
    found = _estimate(make_pass(disturbance=lambda time: times * disturb(time)))
    assert math.isfinite(found.mass) == known


# The signal before t1 is used from the empty belt on, and no longer than it is asked for.
@pytest.mark.parametrize(('empty_begin', 'lead'), [(0, {}), (150, {}), (0, {'lead_time': 0.1})])
def test_mass_and_variance_are_those_of_the_textbook(window, empty_begin, lead):
    window = replace(window, empty_begin=empty_begin)
    found = _estimate(window, **lead)
    mass, variance = _textbook(window, found.mass, **lead)
    assert found.mass == pytest.approx(mass, rel=1e-7)
    assert found.variance == pytest.approx(variance, rel=1e-6)


@pytest.mark.parametrize('gain', [-2, -1, 2])
@pytest.mark.parametrize('sample_rate', [0.0, 960.0])
def test_counts_of_another_load_cell_give_the_same_mass(window, gain, sample_rate):
    scaled = replace(
        window, counts=gain * window.counts, counts_per_kg=gain * window.counts_per_kg,
        zero=gain * window.zero, zero_std_dev=abs(gain) * window.zero_std_dev,
    )  # fmt: skip

    plain, found = (_estimate(w, sample_rate=sample_rate) for w in (window, scaled))

    assert found.mass == pytest.approx(plain.mass, rel=1e-9)
    assert found.variance == pytest.approx(plain.variance, rel=1e-9)


def test_samples_after_t3_reduce_the_variance():
    variances = [
        _estimate(make_pass(trail=trail, zero_std_dev=ZERO_STD_DEV * COUNTS_PER_KG)).variance
        for trail in (0.0, 0.02, 0.05, 0.1)
    ]

    assert variances == sorted(variances, reverse=True)
    assert variances[-1] < 0.95 * variances[0]


@pytest.mark.parametrize(('sample_rate', 'known'), [(950.0, False), (960.5, True)])
def test_at_a_rate_that_was_not_trained_there_is_no_mass(window, sample_rate, known):
    assert math.isfinite(_estimate(window, sample_rate=sample_rate).mass) == known


def test_the_signal_may_begin_while_the_product_enters_but_not_after_it():
    late = make_pass(before=-0.02)  # begins when the product is on by a fifth
    whole = _estimate(make_pass(before=0.01))

    # Less is known of what the platform did before, so the variance is larger.
    assert _estimate(late).mass == pytest.approx(whole.mass, rel=1e-3)
    assert _estimate(late).variance > whole.variance
    assert math.isnan(_estimate(late, entry_end=-0.09).mass)


def test_a_load_that_comes_on_elsewhere_is_reckoned_with():
    # At 1 m/s: on from 0.02 s after t1 to 0.01 s before t2, and off so 0.2 s later.
    time = -0.45 + np.arange(round(0.65 * 960)) / 960
    shape = responses(Platform(38.0, 0.06, 2.5), 0.2, Crossing(0.02, 0.09, 0.22, 0.29), time)[0]
    window = make_pass()
    window = replace(window, counts=np.round(0.2 * shape * COUNTS_PER_KG).astype(np.int32))

    found = _estimate(window, entry_begin=0.02, entry_end=-0.01)

    assert found.mass == pytest.approx(0.2, rel=ROUNDING)


def test_between_trained_speeds_the_noise_model_is_interpolated(window):
    # Halfway between 0.5 and 1.5 m/s the window's 1 m/s has the mean of both.
    off = (0.0005, 0.02)
    lower, upper = (
        tuple(k + sign * d for k, d in zip(REFLECTIONS, off, strict=True)) for sign in (-1, 1)
    )
    lists = ('gain', 'offset', 'std_dev', 'relative_std_dev', 'zero_std_dev')
    two = {name: 2 * getattr(TRAINED, name) for name in lists}
    known = replace(
        TRAINED, speeds=(0.5, 1.5), reflection=(*lower, *upper), noise=(0.5 * NOISE, 1.5 * NOISE),
        impact=(0.6 * IMPACT, 1.4 * IMPACT), **two,
    )  # fmt: skip

    found = GaussMarkov(known).estimate(window)

    plain = _estimate(window)
    assert found.mass == pytest.approx(plain.mass, rel=1e-9)
    assert found.variance == pytest.approx(plain.variance, rel=1e-9)
    assert GaussMarkov(known).estimate(replace(window, belt_speed=0.5)).variance < plain.variance


def test_rows_that_determine_nothing_have_no_solution():
    found = least_squares(np.ones(4), np.zeros((2, 4)), (math.inf, math.inf))
    assert all(math.isnan(value) for value in found)


def test_a_regression_with_a_prior_by_hand():
    # Rows (1, 1) and (1, -1) are orthogonal: 6/2 = 3, and with prior variance 1/2 the second is
    # 4/(2 + 2) = 1. So 4 and 2 are explained of 5 and 1.
    rows, signal = np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([5.0, 1.0])

    assert least_squares(signal, rows, (math.inf, math.sqrt(0.5))) == pytest.approx((3, 0.5, 1))
    assert least_squares(signal, rows[::-1], (math.sqrt(0.5), math.inf)) == pytest.approx(
        (1, 0.25, 1)
    )


def _level_in_noise(**values):
    """Return a window of a constant load, all of it in the coloured noise."""
    window = make_pass(disturbance=_noise(np.random.default_rng(5)), **values)
    still = window.force - make_pass(**values).force
    still[window.window_begin :] += 0.2
    return replace(window, counts=np.round(still * COUNTS_PER_KG).astype(np.int32))


def test_untrained_it_is_the_level_in_noise_as_the_empty_belt_has_it():
    window = _level_in_noise()
    samples = window.force[window.window_begin : window.window_end]
    # Half a sample before t1 and none after: 432 of them.
    empty = window.force[: math.floor(0.45 * 960)]
    coefficients, reflections = burg(empty - np.mean(empty), 40)
    power = np.var(empty) * np.prod(1 - reflections**2)
    noise = covariance(coefficients, math.sqrt(power), len(samples))
    weights = np.linalg.solve(noise, np.ones(len(samples)))

    found = GaussMarkov(GaussMarkovParameters()).estimate(window)

    assert found.mass == pytest.approx(weights @ samples / weights.sum(), rel=ROUNDING)
    assert found.variance == pytest.approx(1 / weights.sum(), rel=1e-6)
    # Noise of 0.1 g, of which 20 Hz fits twice into the window.
    assert found.mass == pytest.approx(0.2, abs=4 * math.sqrt(found.variance) + 4 * ZERO_STD_DEV)


@pytest.mark.parametrize('seen', ['none', 'five samples', 'no noise', 'the last digit alternates'])
@pytest.mark.filterwarnings('error')
def test_untrained_it_is_the_hann_weighted_mean_where_the_empty_belt_tells_nothing(seen):
    window = _level_in_noise()
    entry = math.floor(0.45 * 960)
    if seen == 'none':
        window = replace(window, empty_begin=entry)
    elif seen == 'five samples':
        window = replace(window, empty_begin=entry - 5)
    else:
        window.counts[:entry] = 0 if seen == 'no noise' else np.arange(entry) % 2
    samples = window.force[window.window_begin : window.window_end]

    found = estimate_untrained(window)

    assert found.mass == pytest.approx(hann_mean(samples), rel=1e-12)
    assert found.variance > 0

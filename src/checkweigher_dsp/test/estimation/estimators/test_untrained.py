# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the window of an unknown machine shows, and how much an estimate is doubted by it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from synthetic_line import make_pass, make_window

from checkweigher_dsp.estimation.estimators.base import LoadEstimate
from checkweigher_dsp.estimation.estimators.untrained import (
    doubt,
    lag_doubt,
    rise_misfit,
    window_level,
)
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.platform_response import Platform

STIFF = Platform(400.0, 0.5, 2.5)  # rings above all that a pass shows


def line(frequency, amplitude=0.01, phase=0.7):
    return lambda time: amplitude * np.cos(2 * np.pi * frequency * time + phase)


def drawn(window):
    """Return by which share of their distance the level draws an estimate by the rise."""
    level, _ = window_level(window)
    load = LoadEstimate(level + 1e-3, variance=1e-14)
    return (load.mass - doubt(window, load).mass) / 1e-3


@pytest.mark.parametrize('frequency', [13.0, 26.0, 41.0, 90.0])
def test_of_a_line_less_is_left_than_of_the_means(frequency):
    # Of platforms without ringing; a window of 0.1 s holds 1.3 to 9 periods.
    errors = {'level': [], 'mean': [], 'hann': []}
    for phase in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        window = make_pass(0.2, platform=STIFF, disturbance=line(frequency, phase=phase))
        samples = window.force[window.window_begin : window.window_end]
        errors['level'].append(window_level(window)[0] - 0.2)
        errors['mean'].append(samples.mean() - 0.2)
        errors['hann'].append(hann_mean(samples) - 0.2)
    rms = {name: np.sqrt(np.mean(np.square(values))) for name, values in errors.items()}
    assert rms['level'] < 1.1 * min(rms['mean'], rms['hann']) + 1e-5


def test_of_broad_noise_less_is_left_than_hanns_mean_leaves():
    random = np.random.default_rng(4)
    errors = []
    for _ in range(200):
        window = make_pass(
            0.2, platform=STIFF, disturbance=lambda time: 1e-3 * random.standard_normal(len(time))
        )
        samples = window.force[window.window_begin : window.window_end]
        errors.append((window_level(window)[0] - 0.2, hann_mean(samples) - 0.2))
    level, hann = np.std(errors, axis=0)
    assert level < 0.97 * hann


def test_its_standard_deviation_holds():
    random = np.random.default_rng(5)
    levels = []
    for _ in range(100):
        rumble = np.convolve(random.standard_normal(2000), np.ones(20) / 20, 'same')
        levels.append(
            window_level(
                make_pass(
                    0.2, platform=STIFF, disturbance=lambda time, r=rumble: 1e-3 * r[: len(time)]
                )
            )
        )
    errors, deviations = np.array(levels).T - [[0.2], [0.0]]
    assert 0.5 < np.std(errors) / np.mean(deviations) < 1.5


def test_a_load_that_comes_on_as_assumed_leaves_little_misfit_and_lags_little():
    window = make_pass(0.2)
    assert rise_misfit(window, 0.2) < 0.005 * 0.2  # of its ringing
    assert lag_doubt(window) < 2e-4  # s, most of it what a product that rides on may always do


def test_the_more_a_window_swings_the_more_counts_the_rise():
    windows = [make_pass(0.2, disturbance=line(26.0, swing)) for swing in (1e-3, 1e-2, 5e-2)]
    little, more, most = map(drawn, windows)
    assert 1 > little > more > most > 0


def test_the_further_the_rise_lags_the_more_counts_the_level():
    def lagging(time, lag):
        # Later than the eyes say, by a hump that the thirds of the rise hardly show.
        return line(41.0)(time) - 4 * lag * np.sin(10 * np.pi * np.clip(time, 0, 0.1)) ** 2

    little, more, most = (
        drawn(make_pass(0.2, platform=STIFF, disturbance=partial(lagging, lag=lag)))
        for lag in (5e-4, 1e-3, 2e-3)
    )
    assert 0 < little < more < most < 1


def test_a_rise_that_is_not_seen_has_no_lag_to_doubt():
    assert lag_doubt(replace(make_pass(0.2), t1=None)) == 0.0


def test_a_rise_that_fits_makes_no_estimate_surer_than_the_level():
    window = make_pass(0.2, disturbance=line(13.0, amplitude=1e-3))
    _, deviation = window_level(window)
    found = doubt(window, LoadEstimate(0.2001, variance=1e-14))
    assert 0.5 * deviation < np.sqrt(found.variance) < deviation


def test_a_load_that_comes_on_late_draws_the_estimate_to_the_level():
    # By 10 ms, a tenth of the rise; the level of the window does not know of it.
    window = make_pass(0.2, platform=STIFF, disturbance=lambda time: np.where(
        time < 0.1, -0.2 * np.clip(time, 0, 0.01) * 10, 0.0))  # fmt: skip
    assert rise_misfit(window, 0.2) == pytest.approx(0.02, rel=0.25)
    load = LoadEstimate(0.202, variance=1e-8, a1=0.1, a2=0.2, b1=0.202 * 1.3)
    found = doubt(window, load)
    assert found.mass == pytest.approx(0.2, abs=2e-4)
    assert found.b1 / (1 + found.a1 + found.a2) == pytest.approx(found.mass)


def test_what_the_samples_do_not_go_around_stays_for_the_identifier_to_refuse():
    load = LoadEstimate(0.25, variance=1e-8)
    assert doubt(make_pass(0.2), load) is load


def test_a_signal_that_does_not_move_has_its_level_and_no_deviation():
    window = make_window([0.2] * 64)
    assert window_level(window) == (pytest.approx(0.2, rel=1e-6), pytest.approx(0.0, abs=1e-9))

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weights of the learned estimator, compared with the Gauss-Markov weights and known values."""

from dataclasses import replace

from known_groups import group_of
import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators.learned import Layout
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.evaluating import weigh_passes
from checkweigher_validation.tuning.calibration import index
from checkweigher_validation.tuning.learned import (
    Evidence,
    PointFits,
    Prior,
    TunedLearned,
    empty_belt_covariances,
    point_fits,
    rise_covariance,
    swing_covariance,
)
from checkweigher_validation.tuning.tuner import tune

PARTS = 6


def evidence(count, covariance, curve, seed=3, masses=None):
    random = np.random.default_rng(seed)
    masses = random.choice([0.1, 0.2, 0.3], count) if masses is None else masses
    noise = random.multivariate_normal(np.zeros(len(curve)), covariance, count)
    return Evidence(np.outer(masses, curve) + noise, masses)


def fit(known, prior):
    return point_fits(known, prior).averaged()


@pytest.fixture
def machine():
    """Return the covariance of a machine in kg^2, and the curve of its load."""
    factor = np.random.default_rng(5).standard_normal((PARTS, PARTS))
    return 1e-8 * (factor @ factor.T + 0.1 * np.eye(PARTS)), np.linspace(0.5, 1.0, PARTS)


@pytest.fixture
def nothing():
    """Return a prior without noise."""
    return Prior(*[np.zeros((PARTS, PARTS))] * 4, np.arange(PARTS) + 0.5)


def test_with_many_passes_the_weights_are_those_of_gauss_and_markov(machine, nothing):
    covariance, curve = machine
    weights = fit(evidence(4000, covariance, curve), nothing).weights
    inverse = np.linalg.solve(covariance, curve)
    best = inverse / (inverse @ curve)
    # Variance of the estimates, as a share of the least that there is.
    assert weights @ curve == pytest.approx(1.0, abs=1e-4)
    assert weights @ covariance @ weights < 1.02 * (best @ covariance @ best)


def test_what_is_known_of_the_zero_is_taken_out_though_no_pass_shows_it(machine, nothing):
    # The empty belt is a part of its own: what the zero is off stands there, too.
    covariance, curve = machine
    known = evidence(8, covariance, np.where(np.arange(PARTS), curve, 0.0))
    sums = [abs(fit(known, replace(nothing, zero=zero)).weights.sum()) for zero in (0.0, 1.0)]
    assert sums[1] < 1e-3 < 0.01 < sums[0]


def test_with_few_passes_what_the_empty_belt_shows_makes_up_for_them(machine, nothing):
    covariance, curve = machine
    masses = np.array([0.1, 0.2, 0.3, 0.1])
    few = [evidence(4, covariance, curve, seed, masses) for seed in range(20)]
    informed = replace(nothing, noise=covariance)
    best = 1 / (curve @ np.linalg.solve(covariance, curve))

    def variance(prior):
        found = [fit(each, prior).weights for each in few]
        return np.mean([weights @ covariance @ weights for weights in found])

    assert variance(informed) < min(1.5 * best, 0.5 * variance(nothing))


def test_the_weights_show_the_mean_curve_with_a_gain_of_one(machine, nothing):
    known = evidence(9, *machine)
    assert fit(known, nothing).weights @ known.curve == pytest.approx(1.0)


def test_a_held_out_estimate_is_that_by_weights_from_the_other_passes(machine, nothing):
    known = evidence(40, *machine)
    found = fit(known, nothing)
    by_others, by_all = [], known.features @ found.weights
    for one in range(40):
        others = np.arange(40) != one
        by_others.append(known.features[one] @ fit(known.select(others), nothing).weights)
    # The weights of the points also depend on the pass, a little.
    rest = np.std(found.held_out - by_others)
    assert rest < 0.2 * np.std(by_all - by_others)


def test_points_count_by_the_roots_of_their_likelihoods_here_and_at_the_other_speeds():
    fits = [
        PointFits(np.eye(2), np.array([[0.1], [0.2]]), np.log(each))
        for each in ([1.0, 9.0], [16.0, 1.0], [1.0, 1.0])
    ]
    alone, pooled = fits[0].averaged(), fits[0].averaged(fits[1:])
    # The geometric mean of the likelihoods at the other speeds is 4 and 1.
    assert alone.weights == pytest.approx([1 / 4, 3 / 4])
    assert pooled.weights == pytest.approx([2 / 5, 3 / 5])
    assert pooled.held_out == pytest.approx([0.16])


def test_a_later_rise_of_another_mass_is_taken_out_if_only_one_mass_was_trained():
    curve = np.clip((np.arange(64) - 15.5) / 16, 0, 1)
    masses = np.full(8, 0.2), np.linspace(0.1, 0.3, 8)
    noise = 1e-4 * np.random.default_rng(4).standard_normal((8, 64))
    zeros = np.zeros((64, 64))
    nothing = Prior(*[zeros] * 4, np.arange(64) - 15.5)
    later = np.interp(np.arange(64) - 0.5, np.arange(64), curve) - curve
    one, several = (
        abs(fit(Evidence(np.outer(each, curve) + noise, each), nothing).weights @ later)
        for each in masses
    )
    assert one < 0.1 * several


def test_a_swing_during_the_entry_is_taken_out_though_few_passes_show_it():
    layout, duration = Layout(16, 16, 32), 0.005
    swings, rise = swing_covariance(layout, duration), rise_covariance(layout)
    for each in (swings, rise):
        assert np.trace(each) == pytest.approx(layout.count)
        assert np.linalg.eigvalsh(each).min() > -1e-9
        assert not each[:16].any()  # nothing moves before the product is there
    assert np.count_nonzero(np.diag(rise)) == 16
    curve = np.clip((np.arange(64) - 15.5) / 16, 0, 1)
    random = np.random.default_rng(4)
    draws = random.multivariate_normal(np.zeros(64), 1e-8 * swings + 1e-10 * np.eye(64), 8)
    few = Evidence(0.2 * curve + draws, np.full(8, 0.2))
    zeros = np.zeros((64, 64))
    nothing = Prior(*[zeros] * 4, np.arange(64) - 15.5)
    left = [
        weights @ swings @ weights
        for weights in (
            fit(few, each).weights for each in (replace(nothing, swings=swings), nothing)
        )
    ]
    assert left[0] < 0.7 * left[1]


def test_the_covariances_of_the_empty_belt_are_those_of_its_parts():
    # Before the first product nothing rings; its belt of 0.5 s then reads 1 g in all 40 parts.
    window = group_of(profile='quiet', count=2).passes[0].window
    window = replace(window, zero=window.zero - 1e-3 * window.counts_per_kg)
    found = empty_belt_covariances([window], Layout(4, 8, 8), settle_time=0.0)
    expected = 1e-6 * (1 - np.arange(20) / 40)
    assert found == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize('profile', ['soft', 'floor'])
def test_it_weighs_better_than_the_window_alone_can(profile):
    train, test = (group_of(profile=profile, count=60, speed=1.0, seed=seed) for seed in (3, 4))
    results = {}
    for name in ('hann', 'fir_model', 'learned'):
        tuned = tune([train], [name], LineParameters(), budget=8, n_jobs=1)[name]
        masses = np.array([each.mass for each in weigh_passes(test.passes, tuned.parameters)])
        results[name] = index(masses - test.masses, test.masses)
    assert results['learned'] < 0.8 * results['fir_model'] < 0.8 * results['hann']


def test_other_speeds_teach_where_there_are_few_passes():
    few = group_of(profile='soft', count=6, speed=1.0, seed=5)
    others = [group_of(profile='soft', count=40, speed=speed, seed=6) for speed in (0.75, 1.25)]
    base = TunedLearned.prepare([few, *others], LineParameters())
    alone, helped = (TunedLearned('learned', few, base, rest).lists({}) for rest in ((), others))
    assert alone.keys() == helped.keys()
    assert alone != helped

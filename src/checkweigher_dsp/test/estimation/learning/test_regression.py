# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weights learned from unknown masses, against the bound of Gauss and Markov."""

import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators.learned import PARTS
from checkweigher_dsp.estimation.learning import regression
from checkweigher_dsp.estimation.learning.passage import PassParts

LEAD, RISE, DURATION = 16, 24, 3e-3
TIME = np.arange(LEAD + PARTS) - LEAD + 0.5
CURVE = np.clip(TIME / RISE, 0.0, 1.0)
LEVEL = slice(LEAD + RISE, None)


def _disturbance():
    """Covariance, kg^2: a line on the belt all the time, one after each entry, and white noise."""
    line = np.cos(0.7 * np.subtract.outer(TIME, TIME))
    fading = np.where(TIME > 0, np.exp(-np.maximum(TIME - RISE, 0.0) / 15), 0.0)
    entry = np.cos(0.3 * np.subtract.outer(TIME, TIME)) * np.outer(fading, fading)
    return 1e-6 * (0.3 * line + entry + 0.02 * np.eye(len(TIME)))


def _items(masses, seed=1, covariance=None):
    """Passages of items whose load is first the mean of their level, and the noise of that."""
    covariance = _disturbance() if covariance is None else covariance
    random = np.random.default_rng(seed)
    noise = random.multivariate_normal(np.zeros(len(TIME)), covariance, len(masses))
    parts = np.outer(masses, CURVE) + noise
    return [PassParts(row, LEAD, DURATION, float(row[LEVEL].mean()), 1e-8, 0.0) for row in parts]


def _std_dev(weights, covariance):
    return np.sqrt(weights @ covariance @ weights)


@pytest.mark.parametrize('masses', [(0.1645,), (0.0745, 0.1645, 0.2545)])
def test_the_weights_come_near_to_the_best_ones_of_this_noise(masses):
    covariance = _disturbance()
    best = 1 / np.sqrt(CURVE @ np.linalg.solve(covariance, CURVE))
    mean = np.zeros(len(TIME))
    mean[LEVEL] = 1 / (PARTS - RISE)

    few, many = (regression.fit(_items(np.resize(masses, n)), RISE) for n in (30, 240))

    assert few.trusted
    assert many.trusted
    assert _std_dev(few.weights, covariance) < 0.75 * _std_dev(mean, covariance)
    assert _std_dev(many.weights, covariance) < 1.2 * best
    # What is stated was measured on items that did not teach.
    assert np.sqrt(many.variance) == pytest.approx(_std_dev(many.weights, covariance), rel=0.15)
    assert np.sqrt(many.variance_before) == pytest.approx(_std_dev(mean, covariance), rel=0.15)
    # Of the curve a load of 1 is known, and the noise of a part beside it.
    assert many.weights @ many.curve == pytest.approx(1.0, rel=1e-9)
    assert many.curve == pytest.approx(CURVE, abs=2e-3)
    assert many.noise == pytest.approx(np.sqrt(np.diag(covariance)), rel=0.5)


def test_products_that_differ_by_more_than_their_noise_teach_nothing():
    masses = 0.1645 + 1.5e-3 * np.random.default_rng(5).standard_normal(60)
    found = regression.fit(_items(masses, covariance=1e-3 * _disturbance()), RISE)
    assert found is None or not found.trusted


def test_items_of_all_kinds_of_masses_teach_nothing():
    assert regression.fit(_items(np.geomspace(0.01, 1.0, 40)), RISE) is None


def test_the_gain_is_that_of_the_estimator():
    items = _items(np.resize((0.0745, 0.1645, 0.2545), 60))
    heavier = [
        PassParts(each.parts, LEAD, DURATION, 1.01 * each.load, each.variance, 0.0)
        for each in items
    ]
    plain, scaled = (regression.fit(each, RISE) for each in (items, heavier))
    loads = [found.mass(items[0]) for found in (plain, scaled)]
    assert loads[1] / loads[0] == pytest.approx(1.01, rel=1e-9)


def test_each_held_out_item_is_weighed_as_if_it_had_never_been_there():
    parts = np.array([each.parts for each in _items(np.resize((0.1, 0.2), 24))])
    clusters, prior, item = np.arange(24) % 2, 0.01 * np.eye(len(TIME)), 5

    def within(parts, clusters):
        means = np.array([parts[clusters == each].mean(axis=0) for each in (0, 1)])
        return parts - means[clusters]

    every = within(parts, clusters)
    _, errors = regression.held_out(prior + every.T @ every, CURVE, every, np.full(24, 12 / 11))

    others = np.delete(parts, item, axis=0), np.delete(clusters, item)
    kept = within(*others)
    weights = np.linalg.solve(kept.T @ kept + prior, CURVE)
    weights /= weights @ CURVE
    mean = others[0][others[1] == clusters[item]].mean(axis=0)
    assert errors[item] == pytest.approx(weights @ (parts[item] - mean), rel=1e-6)

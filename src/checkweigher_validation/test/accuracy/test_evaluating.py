# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of passes whose masses, errors and uncertainties are known by construction."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.evaluating import PassSet, evaluate_set, evaluate_sets
from checkweigher_validation.accuracy.passes import KnownPass

COUNTS_PER_KG = 1e6
GRAM = 1000  # counts
TOLERANCE = 1e-9  # relative

# 1.02 times the mean and 1 g; 0.3 g and a zero that is 0.4 g worse than on the training passes.
CALIBRATED = LineParameters().with_values(
    {f'identifier.mean.{name}': (value,) for name, value in (('gain', 1.02), ('offset', 1e-3))}
    | {'identifier.mean.std_dev': (3e-4,), 'identifier.mean.calibrated': True}
    | {'identifier.estimator': 'mean'}
)


def a_pass(mass, reading, speed=1.0, reasons=()):
    """Return a pass of `mass` g in which the load cell reads `reading` g above its zero."""
    counts = np.full(60, 500, np.int32)
    counts[20:] += round(GRAM * reading)
    stamps = (20_000_000, 30_000_000, 60_000_000)
    window = WeighWindow(1, *stamps, belt_speed=speed, product_length=0.1, sample_rate=1000.0)
    cell = {'counts_per_kg': COUNTS_PER_KG, 'zero_counts': 0.0, 'zero': 500.0}
    signal = {'window_begin': 30, 'window_end': 60, 'counts': counts, 'reasons': reasons}
    window = replace(window, zero_std_dev=0.4 * GRAM, **cell, **signal)
    return KnownPass(window, mass / 1000)


PASSES = (
    a_pass(204.0, 200.0),  # weighed as 1.02 * 200 + 1 = 205 g
    a_pass(100.0, 100.0),  # as 103 g
    a_pass(100.0, 0.0, reasons=('Saturation',)),
    a_pass(204.0, 199.0),  # as 203.98 g
    a_pass(204.0, 200.0, speed=1.5),  # at a speed that no training pass had
    a_pass(50.0, -50.0),  # no load
)


def test_errors_uncertainties_and_faults_are_those_of_each_mass():
    known = PassSet(1.0, 'test', PASSES, {0.1: 5e-5, 0.204: 7e-5})
    light, middle, heavy = evaluate_set(known, CALIBRATED)

    assert (light.mass, light.count, light.faults) == (0.05, 0, 1)
    assert np.isnan(light.bound)
    assert (middle.mass, middle.faults, middle.bound) == (0.1, 1, 5e-5)
    assert middle.errors == pytest.approx([3e-3], rel=TOLERANCE)
    assert (heavy.mass, heavy.faults, heavy.bound) == (0.204, 1, 7e-5)
    assert heavy.errors == pytest.approx([1e-3, -2e-5], rel=1e-6)
    for condition in (middle, heavy):
        assert condition.std_devs == pytest.approx(5e-4, rel=TOLERANCE)
    for condition in (light, middle, heavy):
        assert (condition.estimator, condition.speed, condition.part) == ('mean', 1.0, 'test')


def test_references_that_differ_by_less_than_they_are_written_with_are_one_mass():
    known = PassSet(1.0, 'test', (a_pass(100.0, 100.0), a_pass(100.0 + 1e-5, 100.0)), {})
    (condition,) = evaluate_set(known, CALIBRATED)
    assert condition.count == 2


@pytest.mark.parametrize('n_jobs', [1, 2])
def test_estimators_come_in_their_order_each_with_all_sets(n_jobs):
    sets = [PassSet(1.0, 'train', PASSES[:2], {}), PassSet(1.0, 'test', PASSES[:1], {})]
    lines = [CALIBRATED, LineParameters().with_estimator('hann')]
    found = evaluate_sets(sets, lines, n_jobs)
    cases = [('train', 0.1), ('train', 0.204), ('test', 0.204)]
    expected = [(name, *case) for name in ('mean', 'hann') for case in cases]
    assert [(one.estimator, one.part, one.mass) for one in found] == expected

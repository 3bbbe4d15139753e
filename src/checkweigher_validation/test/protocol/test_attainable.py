# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Attainable accuracy on passes whose best linear estimate is known."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_core.records import WeighWindow
from checkweigher_validation.accuracy.passes import KnownPass
from checkweigher_validation.protocol.attainable import attainable_errors

RATE = 500.0
LEAD, RISE, REST = 150, 40, 60  # samples before t1, from t1 to t2 and from t2 to t3


def make_passes(count, seed, noise, line=0.0):
    """Return passes with a known shape, white noise, and a sine `line` of random phase, in kg."""
    random = np.random.default_rng(seed)
    shape = np.concatenate((np.zeros(LEAD), np.linspace(0, 1, RISE), np.ones(REST)))
    passes = []
    for number in range(count):
        mass = (0.1, 0.2, 0.3)[number % 3]
        counts = 1e6 * (mass * shape + noise * random.standard_normal(len(shape)))
        angle = 0.07 * np.arange(len(shape)) + 2 * np.pi * random.random()
        counts += 1e6 * line * np.sin(angle)
        t1, t2, t3 = (round(1e9 * at / RATE) for at in (LEAD, LEAD + RISE, LEAD + RISE + REST))
        window = WeighWindow(number + 1, t1, t2, t3, sample_rate=RATE, counts_per_kg=1e6, zero=0.0)
        ends = {'window_begin': LEAD + RISE, 'window_end': len(shape)}
        window = replace(window, counts=counts.round().astype(np.int32), **ends)
        passes.append(KnownPass(window, mass))
    return passes, shape


@pytest.mark.parametrize('noise', [1e-4, 1e-3])
def test_many_passes_teach_the_best_linear_estimate(noise):
    learn, shape = make_passes(1500, 1, noise)
    check, _ = make_passes(1500, 2, noise)
    found = attainable_errors(learn, check).std()
    # In white noise the bound is that of the matched filter; with as many passes as there are for
    # 200 weights the estimate may be a few percent above.
    assert 0.95 < found / (noise / np.linalg.norm(shape)) < 1.12


def test_few_passes_teach_less():
    # A line has to be told from the load, which a handful of passes does not show.
    learn, _ = make_passes(900, 1, 1e-3, line=2e-2)
    check, _ = make_passes(300, 2, 1e-3, line=2e-2)
    few, many = (attainable_errors(part, check).std() for part in (learn[:9], learn))
    assert many < 0.9 * few


def test_a_zero_that_is_off_is_no_part_of_the_mass():
    # Counts that stand 1 kg higher, with a zero that says so.
    (learn, _), (check, _) = make_passes(300, 1, 1e-4), make_passes(60, 2, 1e-4)
    plain = attainable_errors(learn, check)
    higher = [replace(x.window, zero=1e6, counts=x.window.counts + 1_000_000) for x in check]
    shifted = [KnownPass(window, each.mass) for window, each in zip(higher, check, strict=True)]
    np.testing.assert_allclose(attainable_errors(learn, shifted), plain, rtol=0, atol=1e-12)


def test_the_errors_are_those_of_the_passes_in_their_order():
    learn, _ = make_passes(90, 1, 1e-4)
    check, _ = make_passes(9, 2, 1e-4)
    heavier = [KnownPass(each.window, each.mass + 0.05 * n) for n, each in enumerate(check)]
    difference = attainable_errors(learn, heavier) - attainable_errors(learn, check)
    np.testing.assert_allclose(difference, -0.05 * np.arange(9), rtol=0, atol=1e-12)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Protocol of the paper: its simulated passes, on which no estimator is better than the bound."""

from collections import Counter

import pytest

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_validation.accuracy.errors import average, coverage
from checkweigher_validation.protocol.paper_protocol import (
    MASSES,
    Protocol,
    evaluate_protocol,
    run_protocol,
)

SEGMENTER = SegmenterParameters()


def run(seed=1, speed=1.5, passes=8):
    return run_protocol(Protocol(passes=passes, seed=seed), speed, SEGMENTER)


def masses(passes):
    return [each.mass for each in passes]


def test_the_halves_have_each_mass_equally_often_in_random_order():
    found = run()
    order = masses((*found.train, *found.test))
    for part in (found.train, found.test):
        assert Counter(masses(part)) == dict.fromkeys(MASSES, 4)
    assert masses(found.train) != masses(found.test)
    assert len({tuple(order[n : n + 5]) for n in range(0, 40, 5)}) > 4
    numbers = [each.window.item_id for each in (*found.train, *found.test)]
    assert numbers == list(range(1, 41))
    assert all(each.whole for each in (*found.train, *found.test))


def test_passes_depend_on_seed_and_speed_alone():
    one, other = run(), run()
    assert (one.train, one.test) == (other.train, other.test)
    for change in ({'seed': 2}, {'speed': 1.25}):
        assert masses(run(**change).train) != masses(one.train)


PROTOCOL = Protocol(passes=24, seed=1, speeds=(1.0, 1.5))
ESTIMATORS = ('hann', 'iswd_eksi', 'gauss_markov')


@pytest.fixture(scope='module')
def evaluation():
    return evaluate_protocol(PROTOCOL, ESTIMATORS, LineParameters(), budget=2, n_jobs=1)


def select(conditions, estimator, part='test'):
    return [one for one in conditions if (one.estimator, one.part) == (estimator, part)]


class TestEvaluation:
    def test_every_estimator_weighs_all_passes_of_both_parts(self, evaluation):
        conditions, tuned = evaluation
        assert tuple(tuned) == ESTIMATORS
        for estimator in ESTIMATORS:
            for part in ('train', 'test'):
                found = select(conditions, estimator, part)
                expected = [(speed, mass) for speed in PROTOCOL.speeds for mass in MASSES]
                assert [(one.speed, one.mass) for one in found] == expected
                assert {(one.count, one.faults) for one in found} == {(12, 0)}

    @pytest.mark.parametrize('estimator', ['iswd_eksi', 'gauss_markov'])
    def test_none_is_better_than_the_bound_and_the_tuned_ones_are_better_than_hann(
        self, evaluation, estimator
    ):
        found = average(select(evaluation[0], estimator))
        # 110 degrees of freedom: a standard deviation is known to 7 %.
        assert 0.8 < found.ratio < 2.0
        assert found.std_dev < 0.7 * average(select(evaluation[0], 'hann')).std_dev

    @pytest.mark.parametrize('estimator', ['iswd_eksi', 'gauss_markov'])
    def test_stated_intervals_cover_the_test_passes(self, evaluation, estimator):
        found = select(evaluation[0], estimator)
        assert sum(one.count for one in found) == 120
        assert 0.60 <= coverage(found, 0.68) <= 0.76
        assert 0.90 <= coverage(found, 0.95) <= 0.99

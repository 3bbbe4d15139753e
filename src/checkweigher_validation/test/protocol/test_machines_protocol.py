# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Protocol of random machines: its passes, and estimators relative to the attainable accuracy."""

from collections import Counter

import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_validation.accuracy.errors import average, coverage
from checkweigher_validation.accuracy.machine_tables import ATTAINABLE, CHOSEN, family_text, ratios
from checkweigher_validation.protocol.machines_protocol import (
    MASSES,
    MachinesProtocol,
    evaluate_machines,
    passes_cut_by,
    run_machine,
)

SEGMENTER = SegmenterParameters()
SHORT = MachinesProtocol((3,), training=20, further=150, speeds=(1.5,))


def test_passes_are_of_the_masses_in_random_order_and_repeatable():
    one, again, other = (
        passes_cut_by(3, 1.0, MASSES, 20, seed, [SEGMENTER])[0] for seed in (1, 1, 2)
    )
    assert one == again
    assert Counter(each.mass for each in one) == dict.fromkeys(MASSES, 4)
    assert [each.mass for each in one] != [each.mass for each in other]
    assert all(each.whole for each in one)


def test_training_test_and_further_passes_are_apart():
    run = run_machine(SHORT, 3, 1.5, SEGMENTER)
    assert (len(run.train), len(run.test)) == (20, 120)
    signals = {each.window.counts.tobytes() for each in (*run.train, *run.test)}
    assert len(signals) == 140
    assert sum(one.count for one in run.attainable) == 120


def test_a_machine_may_lack_causes():
    whole, less = (
        passes_cut_by(3, 1.0, MASSES, 10, 1, [SEGMENTER], without)[0]
        for without in ((), ('bounce',))
    )
    assert [each.window.t1 for each in whole] == [each.window.t1 for each in less]
    assert whole[5].window.counts.tobytes() != less[5].window.counts.tobytes()


def test_untrained_passes_are_the_tested_ones_cut_by_the_rise_as_well():
    # Platform and amplifier of this machine are slow: the load comes 12 ms late.
    protocol = MachinesProtocol((8001,), 5, training_masses=(0.1,), further=40)
    run = run_machine(protocol, 8001, 1.0, SEGMENTER)
    assert {each.mass for each in run.train} == {0.1}
    assert {each.mass for each in run.test} == set(MASSES)
    assert [each.window.t1 for each in run.untrained] == [each.window.t1 for each in run.test]
    begins = [
        np.array([one.window.first_index + one.window.window_begin for one in passes if one.whole])
        for passes in (run.test, run.untrained)
    ]
    later = begins[1] - begins[0]
    assert 0.005 < np.median(later) / run.test[0].window.sample_rate < 0.015


@pytest.fixture(scope='module')
def short():
    return evaluate_machines(SHORT, ('mean', 'learned'), LineParameters(), budget=20, n_jobs=1)


def test_machines_are_weighed_tuned_and_untrained(short):
    assert [each.machine for each in short] == [3]
    for each in short:
        assert each.tuned.estimators == (ATTAINABLE, 'mean', 'learned', CHOSEN)
        assert each.chosen == 'learned'
        assert ratios([each.tuned], CHOSEN) == ratios([each.tuned], 'learned')
        assert each.tuned.parts == ('test', 'train')
        assert each.untrained.parts == ('test',)
        for evaluation in (each.tuned, each.untrained):
            for estimator in evaluation.estimators:
                there = evaluation.select(estimator=estimator, part='test')
                assert [one.mass for one in there] == list(MASSES)
                assert (average(there).count, average(there).faults) == (120, 0)
        # What many passes teach is better than a plain mean, and tuning helps.
        assert min(ratios([each.tuned], 'mean')) > 1
        assert ratios([each.tuned], 'learned') < ratios([each.untrained], 'learned')


@pytest.mark.soak
def test_all_estimators_on_machines_that_nobody_modelled(capsys):
    found = evaluate_machines(MachinesProtocol((21, 22, 23)), tuple(ESTIMATORS), LineParameters())
    tuned = [each.tuned for each in found]
    with capsys.disabled():
        print('\n' + family_text(found, 'Machines 21 to 23'))
    mean = {name: float(np.mean(ratios(tuned, name))) for name in ESTIMATORS}
    # No estimator learns more from 120 passes than a regression from 1500, but for chance.
    assert min(mean.values()) > 0.9
    assert min(mean.values()) < 1.5
    for name in ESTIMATORS:
        there = [one for each in tuned for one in each.select(estimator=name, part='test')]
        assert sum(one.count + one.faults for one in there) == 3 * 3 * 120
        assert coverage(there, 0.95) > 0.8

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning: refused passes and learned parameters, in one process and in several."""

from dataclasses import replace
import math

from known_groups import group_of
import numpy as np
import pytest

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.evaluating import weigh_passes
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import folds, index, uncertainty
from checkweigher_validation.tuning.tuner import FEWEST_PASSES, TuningError, tune, untrained

BASE = LineParameters()


def simulated(speed=1.0, count=24, **others):
    return group_of(speed, count=count, seed=11, **others)


@pytest.fixture(scope='module')
def slow():
    return simulated(0.75)


@pytest.fixture(scope='module')
def fast():
    return simulated(1.5)


def changed(group, **values):
    """Return a group whose windows have changed values."""
    passes = tuple(replace(p, window=replace(p.window, **values)) for p in group.passes)
    return replace(group, passes=passes)


class TestRefusals:
    def test_no_passes(self):
        with pytest.raises(TuningError, match='no pass of known mass without'):
            tune([], ['mean'], BASE, n_jobs=1)

    def test_fewer_passes_than_tell_of_their_scatter(self, slow, fast):
        few = SpeedGroup(fast.speed, fast.passes[: FEWEST_PASSES - 1])
        with pytest.raises(TuningError, match=r'2 passes of known mass at 90\.\d m/min'):
            tune([slow, few], ['mean'], BASE, n_jobs=1)

    @pytest.mark.parametrize(
        ('name', 'n_jobs'), [('mean', 1), ('mean', 2), ('iswd_eksi', 1), ('gauss_markov', 1)]
    )
    @pytest.mark.filterwarnings('error')
    def test_passes_without_a_mass(self, slow, fast, name, n_jobs):
        # A load cell that is mounted the other way round.
        upside_down = changed(fast, counts_per_kg=-fast.passes[0].window.counts_per_kg)
        why = rf'{name} finds no mass in some of the 24 passes at 90\.'
        with pytest.raises(TuningError, match=why):
            tune([slow, upside_down], [name], BASE, budget=2, n_jobs=n_jobs)

    def test_signals_that_no_wanted_estimator_can_use(self, fast):
        silent = changed(fast, counts=0 * fast.passes[0].window.counts)
        with pytest.raises(TuningError, match='contain no noise'):
            tune([silent], ['gauss_markov'], BASE, n_jobs=1)

    @pytest.mark.parametrize('name', ['hann', 'tvlpf', 'aid', 'iswd_eksi', 'fir_model'])
    def test_a_few_passes_will_do(self, fast, name):
        few = SpeedGroup(fast.speed, fast.passes[:FEWEST_PASSES])
        tuned = tune([few], [name], BASE, budget=6, n_jobs=1)[name]
        assert tuned.parameters.identifier.chosen.calibrated
        assert all(each.weighed for each in weigh_passes(few.passes, tuned.parameters))


class TestWhatIsLearned:
    def test_of_the_mean_it_is_the_line_through_masses_and_means(self, fast):
        # Nothing is searched, so that all of it can be had from the windows.
        tuned = tune([fast], ['mean'], BASE, n_jobs=1)['mean']
        windows = [each.window for each in fast.passes]
        means = np.array([w.force[w.window_begin : w.window_end].mean() for w in windows])
        masses = fast.masses
        gain, offset = np.polyfit(means, masses, 1)
        errors = gain * means + offset - masses
        groups = [errors[masses == mass] for mass in np.unique(masses)]
        known = tuned.parameters.identifier.mean
        assert known.gain == pytest.approx((gain,), rel=1e-6)
        assert known.offset == pytest.approx((offset,), abs=1e-9)
        assert known.speeds == pytest.approx((fast.speed,), rel=1e-6)
        assert known.zero_std_dev == pytest.approx(
            (np.median([w.zero_std_dev / w.counts_per_kg for w in windows]),), rel=1e-6
        )
        assert known.lightest_mass == (masses.min(),)
        assert known.heaviest_mass == (masses.max(),)
        # Of 24 passes four masses have five and the last one has four, which count alone.
        index = np.mean([abs(e.mean()) + 3 * e.std(ddof=1) for e in groups])
        assert tuned.speeds[0].index == pytest.approx(index, rel=1e-9)
        # The scatter about a line through 19 of 24 passes is a little more than about all.
        std_dev = math.hypot(known.std_dev[0], known.relative_std_dev[0] * masses.mean())
        assert 1.0 < std_dev / np.sqrt(np.mean(errors**2)) < 1.5

    def test_halves_weigh_each_other(self, fast):
        # Passes of two masses in turn; each half has both.
        tuned = tune([simulated(count=40, masses=(0.1, 0.2))], ['mean'], BASE, n_jobs=1)['mean']
        (speed,) = tuned.speeds
        assert 0.8 * speed.index < speed.held_out_index < 1.5 * speed.index

    def test_few_passes_are_weighed_one_by_one_by_what_the_others_taught(self):
        few = simulated(count=19)
        (speed,) = tune([few], ['mean'], BASE, n_jobs=1)['mean'].speeds
        windows = [each.window for each in few.passes]
        means = np.array([w.force[w.window_begin : w.window_end].mean() for w in windows])
        masses = few.masses
        errors = np.empty(19)
        for one in range(19):
            others = np.arange(19) != one
            gain, offset = np.polyfit(means[others], masses[others], 1)
            errors[one] = gain * means[one] + offset - masses[one]
        assert speed.held_out_index == pytest.approx(index(errors, masses), rel=1e-6)
        expected = uncertainty(errors, masses)
        assert speed.uncertainty.std_dev == pytest.approx(expected.std_dev, rel=1e-6)
        assert speed.uncertainty.relative == pytest.approx(expected.relative, rel=1e-6)

    @pytest.mark.parametrize('count', [20, 60])
    def test_what_is_stated_is_how_passes_scatter_that_taught_nothing(self, count):
        (speed,) = tune([simulated(count=count)], ['mean'], BASE, n_jobs=1)['mean'].speeds
        expected = uncertainty(np.array(speed.held_out_errors), np.array(speed.masses))
        assert speed.uncertainty == expected

    @pytest.mark.parametrize(('name', 'taught_by'), [('mean', 53), ('fir_model', 30)])
    def test_eighths_or_halves_are_held_out_in_order_of_entry(self, name, taught_by):
        group = simulated(count=60)
        (speed,) = tune([group], [name], BASE, budget=1, n_jobs=1)[name].speeds
        assert np.array(speed.masses) == pytest.approx(group.masses)
        fold = folds(group.masses, 60 // (60 - taught_by))
        taught = [one for one, out in zip(group.passes, fold == fold[7], strict=True) if not out]
        assert abs(len(taught) - taught_by) <= 1
        learned = tune([SpeedGroup(group.speed, tuple(taught))], [name], BASE, budget=1, n_jobs=1)
        (weighed,) = weigh_passes(group.passes[7:8], learned[name].parameters)
        assert speed.held_out_errors[7] == pytest.approx(weighed.mass - group.masses[7], abs=1e-7)

    def test_the_default_is_judged_as_it_is(self, fast):
        (speed,) = untrained([fast], BASE).speeds
        masses = np.array([each.mass for each in weigh_passes(fast.passes, BASE)])
        assert speed.held_out_index == index(masses - fast.masses, fast.masses)

    @pytest.mark.parametrize(
        'name', ['tvlpf', 'aid', pytest.param('iswd_eksi', marks=pytest.mark.soak)]
    )
    def test_a_larger_budget_is_no_worse_and_a_fair_one_is_better(self, name):
        soft = simulated(count=15, profile='soft')
        found = [
            tune([soft], [name], BASE, budget=budget, n_jobs=1)[name].speeds[0].index
            for budget in (1, 25)
        ]
        assert found[1] < 0.95 * found[0]

    def test_each_speed_has_its_own_values_slowest_first(self, slow, fast):
        tuned = tune([slow, fast], ['tvlpf'], BASE, budget=8, n_jobs=1)['tvlpf']
        alone = [
            tune([group], ['tvlpf'], BASE, budget=8, n_jobs=1)['tvlpf'].parameters.identifier.tvlpf
            for group in (slow, fast)
        ]
        known = tuned.parameters.identifier.tvlpf
        for name in ('speeds', 'gain', 'offset', 'std_dev', 'initial_cutoff', 'half_life'):
            assert getattr(known, name) == tuple(getattr(one, name)[0] for one in alone)
        assert known.speeds[0] < known.speeds[1]
        assert known.calibrated
        assert known.training.startswith('24 passes at 45.0 m/min, 24 passes at 90.')
        assert tuned.parameters.identifier.estimator == 'tvlpf'

    def test_what_is_not_tuned_stays(self, fast):
        base = BASE.with_values({'segmenter.settle_time': 0.3, 'denoise.lambda7': (1.0,) * 5})
        tuned = tune([fast], ['iswd_eksi'], base, budget=2, n_jobs=1)['iswd_eksi']
        assert tuned.parameters.segmenter == base.segmenter
        assert tuned.parameters.denoise.lambda7 == (1.0,)
        assert tuned.parameters.identifier.hann == base.identifier.hann

    def test_it_can_be_tuned_again_from_where_it_ended(self, slow, fast):
        first = tune([slow, fast], ['iswd_eksi'], BASE, budget=2, n_jobs=1)['iswd_eksi']
        again = tune([fast], ['iswd_eksi'], first.parameters, budget=2, n_jobs=1)['iswd_eksi']
        assert again.parameters.denoise.speeds == again.parameters.identifier.iswd_eksi.speeds
        assert len(again.parameters.denoise.speeds) == 1


def test_one_and_two_processes_learn_the_same(slow, fast):
    one, two = (
        tune([slow, fast], ['tvlpf', 'fir_model'], BASE, budget=12, n_jobs=n_jobs)
        for n_jobs in (1, 2)
    )
    assert one == two

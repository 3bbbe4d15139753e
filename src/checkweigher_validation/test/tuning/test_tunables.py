# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the tuner computes for all passes at once, against the stages of the line."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_dsp.denoising.shrinkage_table import TABLE_1
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.estimation.estimators.fir_model import fit_fir
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters
from checkweigher_validation.accuracy.evaluating import weigh_passes
from checkweigher_validation.accuracy.passes import SpeedGroup, group_by_speed, known_passes
from checkweigher_validation.tuning.calibration import folds
from checkweigher_validation.tuning.tunables import estimates_of
from checkweigher_validation.tuning.tuner import TUNABLES, tune

SAME = 1e-9  # relative
# What they give for a training pass, others have taught.
HELD_OUT = ('fir_model', 'gauss_markov', 'learned')
LINES = {
    'paper, slow': {'profile': 'paper', 'speed': 0.5},
    'soft, fast': {'profile': 'soft', 'speed': 1.5, 'sample_rate': 1612.9},
}


@pytest.fixture(scope='module', params=LINES)
def group(request):
    line = Simulation(SimulationParameters(**LINES[request.param], count=15, seed=7))
    (found,) = group_by_speed(known_passes(line.load_cell, line, SegmenterParameters()))
    return found


def tuned_on(group, name, budget=6):
    """Tune, and return what was searched with the parameters, and the tunable."""
    tuned = tune([group], [name], LineParameters(), budget=budget, n_jobs=1)[name]
    tunable = TUNABLES[name](group, TUNABLES[name].prepare([group], LineParameters()))
    values = {key.rpartition('.')[2]: value[0] for key, value in tuned.speeds[0].lists.items()}
    return tuned, tunable, values


@pytest.mark.parametrize('name', [name for name in TUNABLES if name not in HELD_OUT])
def test_the_batch_is_what_the_line_makes_of_each_window(group, name):
    tuned, tunable, values = tuned_on(group, name)
    batch = tunable.estimates(values)
    known = tuned.parameters.identifier.chosen
    expected = known.gain[0] * batch + known.offset[0]
    masses = [each.mass for each in weigh_passes(group.passes, tuned.parameters)]
    assert masses == pytest.approx(expected, rel=SAME)
    assert estimates_of(group, tuned.parameters) == pytest.approx(batch, rel=SAME)
    # Written with 7 digits, gain and offset are still those of the calibration.
    assert tuned.speeds[0].calibration.apply(batch) == pytest.approx(expected, rel=1e-6)


def test_the_weights_of_a_training_pass_are_those_that_the_other_folds_teach(group):
    ridge = 1e-2
    batch = TUNABLES['fir_model'](group, LineParameters()).estimates({'ridge': ridge})
    windows = [raw_samples(each.window) for each in group.passes]
    fold = folds(group.masses, 5)
    for number, window in enumerate(windows):
        others = np.flatnonzero(fold != fold[number])
        curve = fit_fir([windows[n] for n in others], group.masses[others], 24, ridge)
        # Values of the curve at the samples, at unity gain.
        weights = np.interp(np.linspace(0, 23, len(window)), np.arange(24), curve)
        assert batch[number] == pytest.approx(window @ weights / weights.sum(), rel=SAME)


def test_the_noise_that_others_teach_is_about_as_good_as_that_of_all(group):
    base = TUNABLES['gauss_markov'].prepare([group], LineParameters())
    tunable = TUNABLES['gauss_markov'](group, base)
    lists = tunable.lists({'order': 40.0})
    line = base.with_estimator('gauss_markov').with_values(
        {
            **lists, 'identifier.gauss_markov.speeds': (group.speed,),
            'identifier.gauss_markov.order': len(lists['identifier.gauss_markov.reflection']),
        }
    )  # fmt: skip
    batch = tunable.estimates({'order': 40.0}) - group.masses
    line = estimates_of(group, line) - group.masses
    assert np.std(line) < 1.2 * np.std(batch)
    assert np.std(batch) < 2 * np.std(line)
    assert np.max(abs(batch)) < 0.01 * np.min(group.masses)


@pytest.mark.parametrize(('name', 'values'), [('fir_model', {'ridge': 1e-3}),
                                              ('gauss_markov', {'order': 20.0})])  # fmt: skip
def test_the_own_mass_of_a_pass_has_no_part_in_its_estimate(group, name, values):
    # The heaviest mass of all stays that, so that the folds do not change.
    last = max(range(len(group.passes)), key=lambda n: (group.passes[n].mass, n))
    passes = list(group.passes)
    passes[last] = replace(passes[last], mass=1.5 * passes[last].mass)
    rate = group.passes[0].window.sample_rate
    base = LineParameters().with_values({'identifier.gauss_markov.sample_rate': rate})
    one, other = (
        TUNABLES[name](changed, base).estimates(values)
        for changed in (group, SpeedGroup(group.speed, tuple(passes)))
    )
    assert other[last] == one[last]
    assert np.any(other != one)


def test_a_platform_that_the_identifier_refuses_has_no_mass(group):
    # A filter that believes its signal and nothing else identifies what it likes.
    wild = LineParameters().with_values(
        {'identifier.iswd_eksi.coefficient_variance': 100.0,
         'identifier.iswd_eksi.process_noise': 1e-6}
    )  # fmt: skip
    values = {'gamma6': 1.0, 'gamma7': 1.0, 'natural_frequency': 38.0, 'damping_ratio': 0.06,
              'rise_noise': 3.0}  # fmt: skip
    tunable = TUNABLES['iswd_eksi'](group, wild)
    line = wild.with_values(
        {**tunable.lists(values), 'denoise.speeds': (group.speed,),
         'identifier.iswd_eksi.speeds': (group.speed,),
         'identifier.iswd_eksi.calibrated': True}
    )  # fmt: skip
    weighed = [each.weighed for each in weigh_passes(group.passes, line)]
    estimates = tunable.estimates(values)
    assert list(np.isfinite(estimates) & (estimates > 0)) == weighed
    if group.speed > 1:
        assert not all(weighed)


@pytest.mark.parametrize('name', [name for name in TUNABLES if TUNABLES[name].axes])
@pytest.mark.parametrize('end', ['low', 'high', 'start'])
def test_all_that_is_searched_can_be_written_and_gives_masses_or_none(group, name, end):
    tunable = TUNABLES[name](group, LineParameters())
    values = {axis.name: float(getattr(axis, end)) for axis in tunable.axes}
    lists = tunable.lists(values)
    owners = {f'{key.rpartition(".")[0]}.speeds': (group.speed,) for key in lists}
    parameters = (
        LineParameters()
        .with_estimator(name)
        .with_values({**lists, **owners, 'identifier.iswd_eksi.doubt': False})
    )
    assert all(key.startswith(('denoise.', f'identifier.{name}.')) for key in lists)
    if name not in HELD_OUT:
        assert estimates_of(group, parameters) == pytest.approx(
            tunable.estimates(values), rel=SAME, nan_ok=True
        )
    if end == 'start':
        assert np.all(np.isfinite(tunable.estimates(values)))


def test_every_estimator_of_the_line_can_be_tuned():
    assert set(TUNABLES) == set(ESTIMATORS)


@pytest.mark.parametrize(
    ('group', 'budget'),
    [('paper, slow', 10), pytest.param('soft, fast', 30, marks=pytest.mark.soak)],
    indirect=['group'],
)
def test_thresholds_are_searched_where_the_table_has_them_and_stay_off_where_not(group, budget):
    table_1 = {f'denoise.gamma{level}': TABLE_1.gains[level - 5] for level in (5, 6, 7)}
    table_1 |= {f'denoise.lambda{level}': TABLE_1.thresholds[level - 5] for level in (5, 6, 7)}
    base = LineParameters().with_values(table_1)
    with_them, without = (
        tune([group], ['iswd_eksi'], known, budget=budget, n_jobs=1)['iswd_eksi'].parameters
        for known in (base, LineParameters())
    )
    searched = ('gamma5', 'lambda5', 'lambda6', 'lambda7')
    starts = [float(np.interp(group.speed, base.denoise.speeds, getattr(base.denoise, name)))
              for name in searched]  # fmt: skip
    found = [getattr(with_them.denoise, name)[0] for name in searched]
    assert all(abs(one - start) > 1e-3 * start for one, start in zip(found, starts, strict=True))
    assert [getattr(without.denoise, name)[0] for name in searched] == [0.0] * 4

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimates of the tuner for all passes at once, compared with the stages of the line."""

from dataclasses import replace

from known_groups import group_of
import numpy as np
import pytest

from checkweigher_dsp.denoising.shrinkage_table import TABLE_1
from checkweigher_dsp.estimation.estimators import METHODS
from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.estimation.estimators.fir_model import fit_fir
from checkweigher_dsp.estimation.identifier import ComparedParameters
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.evaluating import weigh_passes
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import folds
from checkweigher_validation.tuning.tunables import Tunable, estimates_of
from checkweigher_validation.tuning.tuner import TUNABLES, tune

SAME = 1e-9  # relative
BASE = LineParameters(identifier=ComparedParameters())
LINES = {
    'paper, slow': {'profile': 'paper', 'speed': 0.5},
    'soft, fast': {'profile': 'soft', 'speed': 1.5, 'sample_rate': 1612.9},
}


@pytest.fixture(scope='module', params=LINES)
def group(request):
    return group_of(**LINES[request.param], count=15, seed=7)


def tunable_of(name, group, base=BASE):
    return TUNABLES[name](name, group, base)


def line_of(name, group, lists, base=BASE):
    """Return the parameters of the line that a tunable would write."""
    owners = {f'{key.rpartition(".")[0]}.speeds': (group.speed,) for key in lists}
    values = {**lists, **owners, 'identifier.iswd_eksi.doubt': False}
    return base.with_estimator(name).with_values(values)


def test_what_is_written_weighs_as_the_tuner_did(group):
    tuned = tune([group], ['iswd_eksi'], BASE, budget=6, n_jobs=1)['iswd_eksi']
    values = {key.rpartition('.')[2]: value[0] for key, value in tuned.speeds[0].lists.items()}
    batch = tunable_of('iswd_eksi', group).estimates(values)
    known = tuned.parameters.identifier.chosen
    expected = known.gain[0] * batch + known.offset[0]
    masses = [each.mass for each in weigh_passes(group.passes, tuned.parameters)]
    assert masses == pytest.approx(expected, rel=SAME)
    # Written with 7 digits, gain and offset are still those of the calibration.
    assert tuned.speeds[0].calibration.apply(batch) == pytest.approx(expected, rel=1e-6)


def test_the_weights_of_a_training_pass_are_those_that_the_other_folds_teach(group):
    ridge = 1e-2
    batch = tunable_of('fir_model', group).estimates({'ridge': ridge})
    windows = [raw_samples(each.window) for each in group.passes]
    fold = folds(group.masses, 5)
    for number, window in enumerate(windows):
        others = np.flatnonzero(fold != fold[number])
        curve = fit_fir([windows[n] for n in others], group.masses[others], 24, ridge)
        # Values of the curve at the samples, at unity gain.
        weights = np.interp(np.linspace(0, 23, len(window)), np.arange(24), curve)
        assert batch[number] == pytest.approx(window @ weights / weights.sum(), rel=SAME)


def test_the_noise_that_others_teach_is_about_as_good_as_that_of_all(group):
    tunable = tunable_of('gauss_markov', group, TUNABLES['gauss_markov'].prepare([group], BASE))
    lists = tunable.lists({'order': 40.0})
    order = {'identifier.gauss_markov.order': len(lists['identifier.gauss_markov.reflection'])}
    line = line_of('gauss_markov', group, lists | order, tunable.base)
    batch = tunable.estimates({'order': 40.0}) - group.masses
    of_all = estimates_of(group, line) - group.masses
    assert np.std(of_all) < 1.2 * np.std(batch)
    assert np.std(batch) < 2 * np.std(of_all)
    assert np.max(abs(batch)) < 0.01 * np.min(group.masses)


@pytest.mark.parametrize(
    ('name', 'values'), [('fir_model', {'ridge': 1e-3}), ('gauss_markov', {'order': 20.0})]
)
def test_the_own_mass_of_a_pass_has_no_part_in_its_estimate(group, name, values):
    # The heaviest mass of all stays that, so that the folds do not change.
    last = max(range(len(group.passes)), key=lambda n: (group.passes[n].mass, n))
    passes = list(group.passes)
    passes[last] = replace(passes[last], mass=1.5 * passes[last].mass)
    rate = group.passes[0].window.sample_rate
    base = BASE.with_values({'identifier.gauss_markov.sample_rate': rate})
    one, other = (
        tunable_of(name, changed, base).estimates(values)
        for changed in (group, SpeedGroup(group.speed, tuple(passes)))
    )
    assert other[last] == one[last]
    assert np.any(other != one)


def test_a_platform_that_the_identifier_refuses_has_no_mass(group):
    # A filter that believes its signal and nothing else identifies what it likes.
    own = {'coefficient_variance': 100.0, 'process_noise': 1e-6}
    wild = BASE.with_values({f'identifier.iswd_eksi.{name}': value for name, value in own.items()})
    tunable = tunable_of('iswd_eksi', group, wild)
    values = {axis.name: axis.start for axis in tunable.searched()}
    values |= {'gamma6': 1.0, 'gamma7': 1.0}
    line = line_of('iswd_eksi', group, tunable.lists(values), wild)
    weighed = [each.weighed for each in weigh_passes(group.passes, line)]
    estimates = tunable.estimates(values)
    assert list(np.isfinite(estimates) & (estimates > 0)) == weighed
    if group.speed > 1:
        assert not all(weighed)


@pytest.mark.parametrize('name', [name for name, each in METHODS.items() if each.axes])
@pytest.mark.parametrize('end', ['low', 'high', 'start'])
def test_all_that_is_searched_can_be_written_and_gives_masses_or_none(group, name, end):
    tunable = tunable_of(name, group)
    values = {axis.name: float(getattr(axis, end)) for axis in tunable.searched()}
    lists, estimates = tunable.lists(values), tunable.estimates(values)
    assert all(key.startswith(('denoise.', f'identifier.{name}.')) for key in lists)
    if not METHODS[name].folds:
        found = estimates_of(group, line_of(name, group, lists))
        assert found == pytest.approx(estimates, rel=SAME, nan_ok=True)
    if end == 'start':
        assert np.all(np.isfinite(estimates))


def test_an_estimator_that_is_tuned_alone_is_given_the_denoised_signal(group):
    lists = {'identifier.iswd_eksi.rise_noise': (20.0,)}
    line = line_of('iswd_eksi', group, lists)
    alone = Tunable('iswd_eksi', group, line).estimates({'rise_noise': 20.0})
    assert alone == pytest.approx(estimates_of(group, line), rel=SAME)


@pytest.mark.parametrize(
    ('group', 'budget'),
    [('paper, slow', 10), pytest.param('soft, fast', 30, marks=pytest.mark.soak)],
    indirect=['group'],
)
def test_thresholds_are_searched_where_the_table_has_them_and_stay_off_where_not(group, budget):
    table_1 = {f'denoise.gamma{level}': TABLE_1.gains[level - 5] for level in (5, 6, 7)}
    table_1 |= {f'denoise.lambda{level}': TABLE_1.thresholds[level - 5] for level in (5, 6, 7)}
    base = BASE.with_values(table_1)
    with_them, without = (
        tune([group], ['iswd_eksi'], known, budget=budget, n_jobs=1)['iswd_eksi'].parameters
        for known in (base, BASE)
    )
    for name in ('gamma5', 'lambda5', 'lambda6', 'lambda7'):
        start = np.interp(group.speed, base.denoise.speeds, getattr(base.denoise, name))
        assert getattr(with_them.denoise, name)[0] != pytest.approx(start, rel=1e-3)
        assert getattr(without.denoise, name)[0] == 0.0

"""What the tuner computes for all passes at once, against the stages of the line."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_driver.simulation import Simulation, SimulationParameters
from checkweigher_dsp.line import LineParameters
from checkweigher_dsp.segmentation import SegmenterParameters
from checkweigher_validation.evaluating import weigh_passes
from checkweigher_validation.passes import SpeedGroup, group_by_speed, known_passes
from checkweigher_validation.tuning.tunables import TUNABLES
from checkweigher_validation.tuning.tuner import estimates_of, tune

SAME = 1e-9  # relative
# What they give for a training pass, others have taught.
HELD_OUT = ('fir_model', 'gauss_markov')
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
    tuned = tune([group], [name], LineParameters(), budget=budget, workers=1)[name]
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


@pytest.mark.parametrize('name', HELD_OUT)
def test_what_others_taught_is_about_as_good_as_what_all_taught(group, name):
    tuned, tunable, _ = tuned_on(group, name, budget=2)
    values = {'ridge': 1e-2} if name == 'fir_model' else {'order': 40.0}
    batch = tunable.estimates(values) - group.masses
    line = estimates_of(group, tuned.parameters) - group.masses
    assert np.std(line) < 1.2 * np.std(batch)
    assert np.std(batch) < 4 * np.std(line)
    assert np.max(abs(batch)) < 0.02 * np.min(group.masses)


@pytest.mark.parametrize(('name', 'values'), [('fir_model', {'ridge': 1e-3}),
                                              ('gauss_markov', {'order': 20.0})])  # fmt: skip
def test_the_own_mass_of_a_pass_has_no_part_in_its_estimate(group, name, values):
    # The heaviest mass of all stays that, so that the folds do not change.
    last = max(range(len(group.passes)), key=lambda n: (group.passes[n].mass, n))
    passes = list(group.passes)
    passes[last] = replace(passes[last], mass=1.5 * passes[last].mass)
    base = TUNABLES[name].prepare([group], LineParameters())
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
         'identifier.max_relative_std_dev': 1e9}
    )  # fmt: skip
    weighed = [each.weighed for each in weigh_passes(group.passes, line)]
    assert list(np.isfinite(tunable.estimates(values))) == weighed
    if group.speed > 1:
        assert not all(weighed)


@pytest.mark.parametrize('name', [name for name in TUNABLES if TUNABLES[name].axes])
@pytest.mark.parametrize('end', ['low', 'high', 'start'])
def test_all_that_is_searched_can_be_written_and_gives_masses_or_none(group, name, end):
    tunable = TUNABLES[name](group, LineParameters())
    values = {axis.name: float(getattr(axis, end)) for axis in tunable.axes}
    lists = tunable.lists(values)
    owners = {f'{key.rpartition(".")[0]}.speeds': (group.speed,) for key in lists}
    parameters = LineParameters().with_estimator(name).with_values({**lists, **owners})
    assert all(key.startswith(('denoise.', f'identifier.{name}.')) for key in lists)
    if name not in HELD_OUT:
        assert estimates_of(group, parameters) == pytest.approx(
            tunable.estimates(values), rel=SAME, nan_ok=True
        )
    if end == 'start':
        assert np.all(np.isfinite(tunable.estimates(values)))


def test_every_estimator_of_the_line_can_be_tuned():
    from checkweigher_dsp.estimators import ESTIMATORS

    assert set(TUNABLES) == set(ESTIMATORS)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameter file that tuning writes, read back."""

from datetime import UTC, datetime
import re

from known_groups import groups_of
import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.tuning.parameter_file import parameter_file
from checkweigher_validation.tuning.tuner import tune, untrained

NEW_YEAR = datetime(2026, 1, 1, tzinfo=UTC)


@pytest.fixture(scope='module')
def groups():
    return groups_of(0.75, 1.5, count=8, seed=2)


@pytest.fixture
def read(tmp_path):
    def through_a_file(text):
        path = tmp_path / 'tuned.yaml'
        path.write_text(text, encoding='utf-8')
        return LineParameters.from_file(path)

    return through_a_file


@pytest.mark.parametrize('name', ESTIMATORS)
def test_what_was_tuned_comes_back(groups, read, name):
    tuned = tune(groups, [name], LineParameters(), budget=2, n_jobs=1)
    assert read(parameter_file(tuned, ['a bag'])) == tuned[name].parameters


def test_so_does_everything_that_it_was_tuned_with(groups, read):
    base = LineParameters().with_values(
        {
            'segmenter.settle_time': 0.3,
            'reject.lower_limit': 0.1,
            'denoise.surround': 'level',
            'identifier.hann.gain': (1.01,),
            'identifier.fir_model.knots': 2,
            'identifier.fir_model.weights': (1.0, 1.0),
        }
    )
    tuned = tune(groups, ['fir_model', 'tvlpf'], base, budget=2, n_jobs=1)
    found = read(parameter_file(tuned, []))
    expected = tuned['fir_model'].parameters.with_values(
        {
            f'identifier.tvlpf.{key}': value
            for key, value in tuned['tvlpf'].parameters.identifier.tvlpf.as_mapping().items()
        }
    )
    assert found == expected
    assert found.segmenter.settle_time == 0.3


def test_the_default_that_is_chosen_comes_back_as_it_was(groups, read):
    base = LineParameters().with_values({'segmenter.settle_time': 0.3})
    text = parameter_file({'untrained': untrained(groups, base)}, [])
    assert read(text) == base
    assert '\n# untrained ' in text


def test_of_several_estimators_the_first_is_chosen_and_denoise_is_that_of_iswd_eksi(groups, read):
    tuned = tune(groups, ['hann', 'iswd_eksi'], LineParameters(), budget=2, n_jobs=1)
    found = read(parameter_file(tuned, []))
    assert found.identifier.estimator == 'hann'
    assert found.identifier.hann == tuned['hann'].parameters.identifier.hann
    assert found.identifier.iswd_eksi == tuned['iswd_eksi'].parameters.identifier.iswd_eksi
    assert found.denoise == tuned['iswd_eksi'].parameters.denoise


def test_the_same_passes_give_the_same_file_but_for_the_date(groups):
    one, other = (tune(groups, ['aid'], LineParameters(), budget=20, n_jobs=1) for _ in range(2))
    assert parameter_file(one, ['a'], NEW_YEAR) == parameter_file(other, ['a'], NEW_YEAR)
    lines = zip(
        parameter_file(one, ['a'], NEW_YEAR).splitlines(),
        parameter_file(other, ['a']).splitlines(),
        strict=True,
    )
    changed = [(before, after) for before, after in lines if before != after]
    assert [before for before, _ in changed] == ['# 2026-01-01T00:00:00+00:00']


def test_the_head_says_what_it_was_made_from_and_how_good_it_was(groups):
    tuned = tune(groups, ['mean'], LineParameters(), budget=2, n_jobs=1)
    slow, fast = tuned['mean'].speeds
    text = parameter_file(tuned, ['bags/one: 8 passes', 'bags/two: 8 passes'])
    assert '# from bags/one: 8 passes\n# from bags/two: 8 passes\n' in text
    rows = re.findall(r'^# mean +([\d.]+) +(\d+) +([\d.]+) +([\d.]+)$', text, re.M)
    assert rows == [
        (speed, '8', f'{1000 * each.index:.4f}', f'{1000 * each.held_out_index:.4f}')
        for speed, each in (('45.0', slow), ('90.0', fast))
    ]


def test_the_head_says_how_often_the_intervals_hold_at_each_mass():
    groups = groups_of(1.0, count=20, masses=(0.1, 0.2), seed=2)
    tuned = tune(groups, ['mean'], LineParameters(), n_jobs=1)
    (speed,) = tuned['mean'].speeds
    shares = []
    for mass in (0.1, 0.2):
        errors = np.array(speed.held_out_errors)[np.isclose(speed.masses, mass)]
        stated = np.hypot(speed.uncertainty.std_dev, speed.uncertainty.relative * mass)
        shares.append(f'{100 * np.mean(abs(errors) < 1.96 * stated):.0f}')
    text = parameter_file(tuned, [])
    assert re.search(r'^# mean held out, in 95 % by mass: +100 +200$', text, re.M)
    assert re.search(rf'^# +[\d.]+ m/min +{shares[0]} +{shares[1]}$', text, re.M)


def test_names_that_a_bag_gives_its_load_cell_stay_in_the_comment(groups, read):
    tuned = tune(groups, ['mean'], LineParameters(), budget=2, n_jobs=1)
    hostile = 'bag\n/**/reject:\n  ros__parameters: {lower_limit: 1.0}\r\x00\u2028x'
    assert read(parameter_file(tuned, [hostile])) == tuned['mean'].parameters

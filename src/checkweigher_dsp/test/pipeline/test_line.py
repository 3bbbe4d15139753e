# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stages in one loop on a line whose masses are known."""

from dataclasses import replace
import math

import numpy as np
import pytest
from synthetic_line import make_line

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Decision
from checkweigher_dsp.denoising.denoiser import DenoiseParameters
from checkweigher_dsp.estimation.identifier import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_dsp.rejection.parameters import RejectParameters

COUNT = 1e-6  # kg, to which readings are rounded
# The lines here are those of a platform so stiff that it follows the load at once.
STIFF = LineParameters(denoise=DenoiseParameters(natural_frequency=(1e4,)))
MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)


def _weigh(line, parameters=None, **events):
    weighing_line = WeighingLine(line.load_cell, parameters or STIFF)
    weighings = []
    for event in line.events(**events):
        weighings += weighing_line.add(event)
    return weighings + weighing_line.finish()


@pytest.mark.parametrize('estimator', ESTIMATORS)
@pytest.mark.parametrize('speed', [0.5, 0.75, 1.0, 1.25, 1.5])
def test_a_line_without_noise_weighs_each_item(speed, estimator):
    weighings = _weigh(make_line(MASSES, speed=speed), STIFF.with_estimator(estimator))

    assert [weighing.estimate.item_id for weighing in weighings] == [1, 2, 3, 4, 5]
    for weighing, mass in zip(weighings, MASSES, strict=True):
        # The load stands still from t2 to t3: nothing but rounding is between it and the mass.
        assert weighing.estimate.mass == pytest.approx(mass, abs=2 * COUNT)
        assert weighing.verdict.mass == weighing.estimate.mass
        assert weighing.verdict.decision is Decision.ACCEPT


@pytest.mark.parametrize('estimator', ESTIMATORS)
def test_noise_is_averaged_and_the_standard_deviation_covers_the_error(estimator):
    # That of ISWD-EKSI does if R is all that denoising removed and not a share of it.
    parameters = STIFF.with_values(
        {'identifier.estimator': estimator, 'identifier.iswd_eksi.measurement_noise': 1.0}
    )
    line = make_line(tuple([0.2] * 20))
    noise = np.random.default_rng(3).normal(0, 500, len(line.counts))  # 0.5 g
    line.counts[:] = line.counts + np.round(noise).astype(np.int32)

    estimates = [weighing.estimate for weighing in _weigh(line, parameters)]

    errors = np.array([estimate.mass - 0.2 for estimate in estimates])
    # The least variance is that of the mean of 96 samples, 0.5 g / sqrt(96) = 0.05 g; the method
    # reaches it within a factor of three, and no error of twenty is beyond five sigma.
    assert np.sqrt(np.mean(errors**2)) < 3 * 0.5e-3 / math.sqrt(96)
    assert all(abs(e) < 5 * estimate.std_dev for e, estimate in zip(errors, estimates, strict=True))


def test_each_item_gets_one_verdict_and_a_fault_no_mass():
    weighings = _weigh(make_line(MASSES), without=[(1, 't2')], lost=(2200, 2250))

    # The third enters at 2.2 s, that is sample 2112.
    assert [list(w.verdict.reasons) != [] for w in weighings] == [False, True, True, False, False]
    assert [w.verdict.item_id for w in weighings] == [1, 2, 3, 4, 5]
    for weighing in (weighings[1], weighings[2]):
        assert weighing.verdict.decision is Decision.FAULT
        assert math.isnan(weighing.verdict.mass)
        assert weighing.verdict.reject_at is not None
    assert [w.estimate.mass for w in weighings if w.estimate.weighed] == pytest.approx(
        [MASSES[0], MASSES[3], MASSES[4]], abs=2 * COUNT
    )


def test_limits_and_the_rejector_are_those_of_the_parameters():
    line = make_line(MASSES, speed=0.5)
    reject = RejectParameters(lower_limit=0.1, upper_limit=0.19, rejector_distance=0.25)

    verdicts = [w.verdict for w in _weigh(line, replace(STIFF, reject=reject))]

    decisions = [verdict.decision.name for verdict in verdicts]
    assert decisions == ['UNDER', 'ACCEPT', 'ACCEPT', 'OVER', 'OVER']
    # 0.25 m at 0.5 m/s; the speed is from stamps of 1 ns.
    assert [verdict.reject_at for verdict in verdicts] == pytest.approx(
        [product.t3 + 500_000_000 for product in line.products], abs=10
    )


def test_a_file_sets_what_it_names_and_leaves_the_rest(tmp_path):
    path = tmp_path / 'line.yaml'
    path.write_text(
        '/**/segmenter:\n  ros__parameters: {min_window: 20}\n'
        '/**/denoise:\n  ros__parameters: {stretch: 2048, gamma5: [0, 0, 0, 0, 0.5]}\n'
        'identifier:\n  ros__parameters: {iswd_eksi: {process_noise: 0.5}, tvlpf.gain: [1.5]}\n'
        '/lane1/reject:\n  ros__parameters: {upper_limit: .inf, lower_limit: 0.07}\n'
        '/**/driver:\n  ros__parameters: {source: bag}\n'
    )

    parameters = LineParameters.from_file(path)

    default = LineParameters()
    assert parameters == LineParameters(
        replace(default.segmenter, min_window=20),
        replace(default.denoise, stretch=2048, gamma5=(0.0, 0.0, 0.0, 0.0, 0.5)),
        replace(
            default.identifier,
            iswd_eksi=replace(default.identifier.iswd_eksi, process_noise=0.5),
            tvlpf=replace(default.identifier.tvlpf, gain=(1.5,)),
        ),
        replace(default.reject, lower_limit=0.07),
    )


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('reject:\n  ros__parameters: {lower_limit: .nan}\n', 'reject.lower_limit: nan'),
        ('reject:\n  ros__parameters: {lower_limit: 2, upper_limit: 1}\n', 'reject.lower_limit'),
        ('denoise:\n  ros__parameters: {gamma5: [0.1]}\n', 'denoise.speeds: each gain and'),
        ('segmenter:\n  ros__parameters: {min_windw: 20}\n', 'segmenter.min_windw: no such'),
        ('identifier:\n  ros__parameters: {estimator: best}\n', "identifier.estimator: 'best'"),
        ('identifier:\n  ros__parameters: {tvlpf: {gain: [0]}}\n', 'identifier.tvlpf.gain: 0 is'),
        ('identifier:\n  ros__parameters: {tvlpf: {gian: [1]}}\n', 'identifier.tvlpf.gian: no'),
        ('rejekt:\n  ros__parameters: {lower_limit: 1.0}\n', 'line 3: rejekt: addresses none of'),
    ],
)
def test_a_wrong_file_is_refused_in_one_line_naming_file_and_parameter(tmp_path, text, complaint):
    path = tmp_path / 'line.yaml'
    path.write_text(
        'segmenter:\n  ros__parameters: {lead_time: 0.1}\n' * ('segm' not in text) + text
    )

    with pytest.raises(ParameterError) as error:
        LineParameters.from_file(path)

    assert str(error.value).startswith(f'{path}: ')
    assert complaint in str(error.value)
    assert '\n' not in str(error.value)


def test_another_estimator_changes_nothing_else():
    parameters = LineParameters(reject=RejectParameters(lower_limit=0.1))

    assert parameters.with_estimator('iswd_eksi') == parameters
    with pytest.raises(ParameterError, match=r'identifier\.estimator'):
        parameters.with_estimator('none')


@pytest.mark.parametrize(
    ('name', 'complaint'),
    [
        ('segmenter.min_windw', r'segmenter\.min_windw: no such'),
        ('identifier.tvlpf.gian', r'identifier\.tvlpf\.gian: no such.*tvlpf\.gain'),
        ('rejekt.lower_limit', "'rejekt.lower_limit' addresses none of segmenter"),
        ('', "'' addresses none of segmenter"),
    ],
)
def test_a_change_of_what_there_is_not_is_refused(name, complaint):
    with pytest.raises(ParameterError, match=complaint):
        LineParameters().with_values({name: 1.0})


def test_single_values_are_changed_by_their_name_and_nothing_else():
    parameters = LineParameters(reject=RejectParameters(lower_limit=0.1))

    changed = parameters.with_values(
        {'segmenter.min_window': 20, 'identifier.tvlpf.gain': [1.5], 'identifier.estimator': 'hann'}
    )

    assert parameters.with_values({}) == parameters
    assert changed.segmenter == replace(parameters.segmenter, min_window=20)
    assert changed.identifier.chosen == parameters.identifier.hann
    assert changed.identifier.tvlpf == replace(parameters.identifier.tvlpf, gain=(1.5,))
    assert changed.reject == parameters.reject

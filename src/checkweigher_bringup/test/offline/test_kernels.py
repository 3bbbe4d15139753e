# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Windows in batches, compared with single windows and with the plain computation."""

from dataclasses import astuple, replace

from lines import simulated, weigh_all
import numpy as np
import plain_path
import pytest
from running import BAGS

from checkweigher_core.records import Reference
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.denoising.shrinkage_table import TABLE_1
from checkweigher_dsp.estimation.estimators.iswd_eksi import IswdEksiParameters
from checkweigher_dsp.estimation.identifier import ESTIMATORS, Identifier, IdentifierParameters
from checkweigher_dsp.pipeline import line
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter
from checkweigher_recording.bags.reading import read_bag

COLUMNS = ('gamma5', 'gamma6', 'gamma7', 'lambda5', 'lambda6', 'lambda7')
TABLES = {
    'default': DenoiseParameters(),
    'thresholds': DenoiseParameters(
        threshold_unit=1e-6,
        **dict(zip(COLUMNS, (*TABLE_1.gains, *TABLE_1.thresholds), strict=True)),
    ),
}


def _windows(recording):
    segmenter = Segmenter(recording.load_cell, SegmenterParameters())
    windows = []
    for event in recording:
        if not isinstance(event, Reference):
            windows += segmenter.take(event)
    return windows + segmenter.finish()


@pytest.mark.parametrize('table', TABLES)
@pytest.mark.parametrize('speed', [0.5, 0.8, 1.5])
def test_a_window_weighs_what_pywavelets_and_filterpy_make_of_it(speed, table):
    windows = _windows(simulated(speed=speed, count=3, seed=3))
    parameters, known = TABLES[table], IswdEksiParameters(doubt=False)
    estimator = ESTIMATORS['iswd_eksi'](known)

    for window in windows:
        found = estimator.estimate(Denoiser(parameters).denoise(window))

        expected = plain_path.weigh_window(window, parameters, known)
        assert (found.mass, found.variance) == pytest.approx(expected, rel=1e-10)
    assert len(windows) == 3


@pytest.mark.parametrize('steps', [12, 1500])
@pytest.mark.parametrize('bag', sorted(path.name for path in BAGS.glob('paper_*')))
def test_a_bag_weighed_at_once_has_the_same_bits_as_event_by_event(bag, steps, monkeypatch):
    monkeypatch.setattr(line, '_STEPS_AT_ONCE', steps)
    recording = read_bag(BAGS / bag)
    events = [event for event in recording if not isinstance(event, Reference)]
    one_by_one = WeighingLine(recording.load_cell, LineParameters())
    expected = [weighing for event in events for weighing in one_by_one.add(event)]
    expected += one_by_one.finish()

    found = list(weigh_all(recording))

    assert [repr(astuple(each)) for each in found] == [repr(astuple(each)) for each in expected]
    assert len(found) == 25


@pytest.mark.parametrize(('table', 'uncertain'), [*((t, 0.0) for t in TABLES), ('default', 1.3e-3)])
def test_many_windows_at_once_have_the_same_bits_as_each_alone(table, uncertain):
    # Three speeds, shapes of their own; enough of each to be identified at once.
    random = np.random.default_rng(7)
    windows = [
        replace(window, counts=window.counts + random.integers(-200, 200, len(window.counts)))
        for speed in (0.5, 1.0, 1.5)
        for window in _windows(simulated(speed=speed, count=4, seed=1)) * 25
    ]
    windows[5] = replace(windows[5], zero=float('nan'))
    windows[6] = replace(windows[6], reasons=('DistanceFault',))
    denoiser = Denoiser(replace(TABLES[table], edge_uncertainty=uncertain))
    identifier = Identifier(IdentifierParameters())

    together = identifier.estimate_all(denoiser.denoise_all(windows))

    assert sum(each.weighed for each in together) >= 290
    for number in (*range(12), *range(12, 300, 7)):
        alone = identifier.estimate(denoiser.denoise(windows[number]))
        assert repr(together[number]) == repr(alone)


@pytest.mark.parametrize('estimator', sorted(ESTIMATORS))
def test_estimators_that_weigh_the_raw_signal_do_not_read_the_denoised_one(estimator):
    identifier = Identifier(replace(IdentifierParameters(), estimator=estimator))
    (window,) = _windows(simulated(speed=1.0, count=1, seed=1))
    denoised = Denoiser(DenoiseParameters()).denoise(window)

    without, with_it = identifier.estimate(window), identifier.estimate(denoised)

    assert with_it.weighed
    assert (repr(without) == repr(with_it)) != identifier.needs_denoised

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The figures of the page show the numbers of their items."""

from dataclasses import replace

from lines import simulated
import numpy as np
import pytest

from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.records import Decision
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.recording import Recording
from checkweigher_validation.accuracy.passes import known_passes
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web import charts
from checkweigher_web.lane import Item


@pytest.fixture(scope='module')
def recording() -> Recording:
    return simulated(count=4, seed=2)


@pytest.fixture
def item(recording: Recording) -> Item:
    (result, *_) = weigh(recording, LineParameters())
    (known, *_) = known_passes(recording.load_cell, recording, SegmenterParameters())
    denoised = Denoiser(DenoiseParameters()).denoise(known.window)
    return Item(result.verdict, result.estimate, denoised, t4=result.t4, reference=0.0745)


def series_of(figure: charts.Options) -> dict[str, charts.Options]:
    return {each['name']: each for each in figure['series']}


def test_the_signal_has_the_mass_its_interval_and_the_edges(item: Item, recording: Recording):
    found = series_of(charts.signal_chart(item, recording.load_cell))
    assert set(found) == {'raw', 'denoised', 'mass', 'reference'}
    mass, std_dev = 1e3 * item.verdict.mass, 1e3 * item.verdict.std_dev
    assert [y for _, y in found['mass']['data']] == pytest.approx([mass, mass], abs=1e-4)
    low, high = found['mass']['markArea']['data'][0]
    assert (low['yAxis'], high['yAxis']) == pytest.approx((mass - 2 * std_dev, mass + 2 * std_dev))
    marks = {mark['name']: mark['xAxis'] for mark in found['raw']['markLine']['data']}
    assert list(marks) == ['t1', 't2', 't3', 't4']
    # 0.1 m and 0.2 m at 1 m/s
    assert list(marks.values()) == pytest.approx([0, 100, 200, 300], rel=0.02)


def test_the_histogram_counts_the_accepted_items_alone(item: Item):
    light = replace(item, verdict=replace(item.verdict, decision=Decision.UNDER, mass=0.01))
    heavier = replace(item, verdict=replace(item.verdict, mass=item.verdict.mass + 1e-3))
    (bars,) = charts.histogram([item, light, heavier, heavier], None)['series']
    assert sum(count for _, count in bars['data']) == 3


def test_what_came_before_the_page_was_open_says_so(item: Item):
    figure = charts.signal_chart(replace(item, window=None), None)
    assert 'before this page was open' in figure['title']['text']


def test_a_long_signal_is_thinned_out(item: Item, recording: Recording):
    assert item.window is not None
    window = replace(item.window, counts=np.resize(item.window.counts, 100_000))
    window = replace(window, denoised=np.zeros(0))
    figure = charts.signal_chart(replace(item, window=window), recording.load_cell)
    assert len(figure['series'][0]['data']) <= 1200

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of the page, compared with the values of their items."""

from collections.abc import Sequence
from dataclasses import replace

from lines import simulated
import numpy as np
import pytest

from checkweigher_core.recording import Recording
from checkweigher_core.records import GRAMS, Decision, Verdict
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_production.recipes import Product
from checkweigher_production.statistics import ProductionStatistics
from checkweigher_validation.accuracy.passes import known_passes
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web.charts import Options, local_times
from checkweigher_web.lane import ShownItem
from checkweigher_web.mass_series import MassSeries
from checkweigher_web.views.control_charts import control_figure
from checkweigher_web.views.empty_belt import SpectralLine, Spectrum, spectrum_chart
from checkweigher_web.views.masses import histogram
from checkweigher_web.views.signal import signal_chart


@pytest.fixture(scope='module')
def recording() -> Recording:
    return simulated(count=4, seed=2)


@pytest.fixture
def item(recording: Recording) -> ShownItem:
    (result, *_) = weigh(recording, LineParameters())
    (known, *_) = known_passes(recording.load_cell, recording, SegmenterParameters())
    denoised = Denoiser(DenoiseParameters()).denoise(known.window)
    return ShownItem(result.verdict, result.estimate, denoised, t4=result.t4, reference=0.0745)


def series_of(figure: Options) -> dict[str, Options]:
    return {each['name']: each for each in figure['series']}


def test_the_signal_has_the_mass_its_interval_and_the_edges(item: ShownItem, recording: Recording):
    found = series_of(signal_chart(item, recording.load_cell)[0])
    assert set(found) == {
        'raw', 'denoised', 'mass ± 2 s', 'reference', 'raw, t2 to t3', 'denoised, t2 to t3',
        'mass, t2 to t3',
    }  # fmt: skip
    mass, std_dev = 1e3 * item.verdict.mass, 1e3 * item.verdict.std_dev
    assert [y for _, y in found['mass ± 2 s']['data']] == pytest.approx([mass, mass], abs=1e-4)
    low, high = found['mass, t2 to t3']['markArea']['data'][0]
    assert (low['yAxis'], high['yAxis']) == pytest.approx((mass - 2 * std_dev, mass + 2 * std_dev))
    marks = {mark['name']: mark['xAxis'] for mark in found['raw']['markLine']['data']}
    assert list(marks) == ['t1', 't2', 't3', 't4']
    # distances of 0.1 m and 0.2 m at 1 m/s
    assert list(marks.values()) == pytest.approx([0, 100, 200, 300], rel=0.02)


def test_the_histogram_counts_the_accepted_items_alone_with_what_belongs_to_them(item: ShownItem):
    light = replace(item.verdict, decision=Decision.UNDER, mass=0.01)
    heavier = replace(item.verdict, mass=item.verdict.mass + 1e-3, lower_limit=0.06)
    series = MassSeries()
    for verdict in (item.verdict, light, heavier, heavier):
        series = series.with_item(verdict)
    own = ProductionStatistics(Product('', nominal=0.07, tu1=0.065)).summary()
    for statistics, lines in (
        (own, {'lower': 60, 'TU2': 61, 'TU1': 65, 'nominal': 70}),
        (replace(own, product='of the next item'), {'lower': 60}),
        (None, {'lower': 60}),
    ):
        (bars,) = histogram(series, heavier, statistics)['series']
        assert sum(count for _, count in bars['data']) == 3
        width = bars['data'][1][0] - bars['data'][0][0]
        assert (bars['data'][0][0] - 60) % width == pytest.approx(width / 2)  # limits are bounds
        marks = {mark['name']: mark['xAxis'] for mark in bars['markLine']['data']}
        assert marks == pytest.approx(lines)


def labels_of(figure: Options, width: int) -> list[tuple[float, float, float]]:
    """Return left end, right end and height in px of each label in a figure of `width` px."""
    axis, found = figure['xAxis'], []
    scale = width / (axis['max'] - axis['min'])
    for mark in figure['series'][0]['markLine']['data']:
        at, half = scale * (mark['xAxis'] - axis['min']), 3.2 * len(mark['name'])
        found.append((at - half, at + half, mark['label']['distance']))
    return found


def test_labels_of_limits_and_lines_do_not_touch_on_a_phone_or_elsewhere(item: ShownItem):
    series = MassSeries(masses=(0.148, 0.152))
    verdict = replace(item.verdict, lower_limit=0.1465, upper_limit=0.1582)
    statistics = ProductionStatistics(Product('', nominal=0.15, tu1=0.1455, tu2=0.141)).summary()
    lines = tuple(SpectralLine(at, 1e-3, '') for at in (31.0, 39.0, 50.0, 100.0))
    spectrum = Spectrum(np.arange(200.0), np.ones(200), lines)
    for figure, count in (
        (histogram(series, verdict, statistics), 5), (spectrum_chart(spectrum), 4),
    ):  # fmt: skip
        for width in (200, 350, 700):
            labels = sorted(labels_of(figure, width))
            assert len(labels) == count
            for k, (_, right, height) in enumerate(labels):
                for left, _, other in labels[k + 1 :]:
                    assert right < left or abs(height - other) >= 12
        # The labels are above the bars and below the edge of the figure.
        assert max(height for *_, height in labels) + 12 <= figure['grid']['top']
    (_, _, highest), *_ = sorted(labels_of(figure, 200), key=lambda label: -label[2])
    assert highest < 30  # two levels suffice


def control_figures(masses: Sequence[float], known: int = 0) -> tuple[Options, Options]:
    """Return the control charts of masses in g, one per second, without the first `known` ones."""
    series = MassSeries()
    for second, mass in enumerate(masses):
        stamp = second * 1_000_000_000
        series = series.with_item(Verdict(1, stamp, Decision.ACCEPT, mass=mass / GRAMS))
    series = replace(series, masses=series.masses[known:], stamps=series.stamps[known:])
    means, spreads = (control_figure(series, spread=spread) for spread in (False, True))
    return means, spreads


def test_the_control_chart_says_where_a_run_of_subgroups_begins_to_break_a_rule():
    spread = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    levels = [*[0, 0.1, 0, -0.1] * 5, 9, 9, 0, *[0.1] * 9]  # the first 20 are the reference
    groups = [level + spread for level in levels] + [4 * spread, 4 * spread]
    means, spreads = control_figures(np.concatenate(groups))

    def at(group: int) -> float:
        return float(local_times([(5 * group + 4) * 1e9])[0])  # the last item of a subgroup

    assert [point[0] for point in series_of(means)['mean']['data']] == [*map(at, range(34))]
    assert series_of(means)['beyond the limits']['data'] == [[at(20), 9]]
    assert [each for each, _ in series_of(means)['7 on one side']['data']] == [at(29)]
    beyond = series_of(spreads)['beyond the limit']['data']
    assert beyond == [[at(32), pytest.approx(np.std(4 * spread, ddof=1), abs=1e-4)]]
    for figure in (means, spreads):
        assert figure['legend']['show']
    symbols = {
        name: each['symbol'] for name, each in series_of(means).items() if each['type'] == 'scatter'
    }
    assert len(set(symbols.values())) == len(symbols) == 2


def test_limits_are_those_of_the_reference_when_the_process_drifts():
    masses = [*np.tile([149.0, 150.0, 151.0, 150.0, 150.0], 20), *[170.0] * 50]
    limits = [
        {mark['name']: mark['yAxis'] for mark in figure['series'][0]['markLine']['data']}
        for figure in (control_figures(masses[:100])[0], control_figures(masses, 100)[0])
    ]
    assert limits[0] == limits[1]


@pytest.mark.parametrize('spread', [False, True])
def test_the_limits_of_a_calm_control_chart_can_be_seen(spread: bool):
    random = np.random.default_rng(2)
    masses = 150 + 0.5 * random.standard_normal(40)
    figure = control_figures(masses.tolist())[spread]
    axis, line = figure['yAxis'], figure['series'][0]
    limits = [mark['yAxis'] for mark in line['markLine']['data']]
    assert max(y for _, y in line['data']) < max(limits)  # a limit is beyond the data
    for value in (*limits, *(y for _, y in line['data'])):
        assert axis['min'] < value < axis['max']


def test_what_came_before_the_page_was_open_says_so(item: ShownItem):
    figure = signal_chart(replace(item, window=None), None)[0]
    assert 'before this page was open' in figure['title']['text']


def test_a_long_signal_is_thinned_out(item: ShownItem, recording: Recording):
    window = replace(item.window, counts=np.resize(item.window.counts, 100_000))
    window = replace(window, denoised=np.zeros(0))
    figure = signal_chart(replace(item, window=window), recording.load_cell)[0]
    assert len(figure['series'][0]['data']) <= 1200


def test_a_signal_lies_over_those_of_the_items_before_it(item: ShownItem, recording: Recording):
    window = item.window
    figure = signal_chart(item, recording.load_cell, [window] * 3)[0]
    before = figure['series'][0]
    assert before['name'] == 'last 3 items'
    curves = [[]]
    for at, force in before['data']:
        if at is None:
            curves.append([])
        else:
            curves[-1].append((at, force))
    assert curves[0] == curves[1] == curves[2]
    assert 50 <= len(curves[0]) <= 120
    at, force = curves[0][0]
    assert (at, force) == pytest.approx(
        ((window.stamp - window.t1) / 1e6, 1e3 * window.force[0]), abs=0.01
    )
    # The legend omits the series of the plateau, which would repeat the names.
    assert [each['name'] for each in figure['legend']['data']] == [
        'last 3 items', 'raw', 'denoised', 'mass ± 2 s', 'reference',
    ]  # fmt: skip
    upper, lower = figure['xAxis'][0], figure['xAxis'][1]
    assert (upper['name'], lower['name']) == ('ms after t1', 'plateau, ms after t1')

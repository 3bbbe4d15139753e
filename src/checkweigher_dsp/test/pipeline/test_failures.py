# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stage that fails on an item makes it a FAULT and goes on; no time of edges makes it fail."""

import os

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from synthetic_line import make_line, make_pass, run_segmenter

from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.estimators import ESTIMATORS, METHODS
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.items.failures import Failures
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
MS = 1_000_000
FAILED = ('StageFailed',)
MEAN = IdentifierParameters(estimator='mean')


@pytest.fixture
def failed():
    return []


@pytest.fixture
def failures(failed):
    return Failures(lambda item_id, error: failed.append((item_id, type(error))))


class OddCheck(EdgeCheck):
    """Edge check that fails on every second item."""

    def check(self, seen, speed, length):
        assert (self.checked + self.unchecked) % 2 == 0 or not self._skip()
        return super().check(seen, speed, length)

    def _skip(self):
        self.unchecked += 1
        return True


def test_the_segmenter_goes_on_after_an_item_on_which_it_failed(failed, failures):
    line = make_line((0.1,) * 4)
    segmenter = Segmenter(line.load_cell, SegmenterParameters(), 0, failures)
    segmenter.cutter.edge_check = OddCheck(SegmenterParameters())

    windows = run_segmenter(segmenter, line.events())

    assert [(w.item_id, w.reasons) for w in windows] == [(1, ()), (2, FAILED), (3, ()), (4, FAILED)]
    assert failed == [(2, AssertionError), (4, AssertionError)]
    assert windows[1].line_speed == windows[0].line_speed  # for the time of the rejector


def test_a_window_on_which_a_stage_fails_costs_itself_alone(failed, failures, monkeypatch):
    class Mean(ESTIMATORS['mean']):
        def estimate_all(self, windows):
            assert all(window.item_id != 2 for window in windows)
            return super().estimate_all(windows)

    monkeypatch.setitem(METHODS, 'mean', Mean)
    windows = [make_pass(item_id=number) for number in (1, 2, 3)]
    unreadable = make_pass(item_id=4, counts=np.full(len(windows[0].counts), 'x'))

    denoised = Denoiser(DenoiseParameters(), failures).denoise_all([*windows, unreadable])
    estimates = Identifier(MEAN, failures=failures).estimate_all(denoised)

    assert [estimate.reasons for estimate in estimates] == [(), FAILED, (), FAILED]
    assert [number for number, _ in failed] == [4, 2]


@pytest.mark.parametrize('count', [20, pytest.param(12_500, marks=pytest.mark.soak)])
def test_no_time_of_edges_and_samples_makes_a_stage_fail(failed, failures, count):
    denoiser = Denoiser(DenoiseParameters(), failures)
    times = st.integers(-300 * MS, 300 * MS)

    @settings(
        max_examples=EXAMPLES or count, deadline=None, suppress_health_check=list(HealthCheck)
    )
    @given(
        st.sampled_from(tuple(ESTIMATORS)), st.floats(0.15, 2.9), st.floats(0.006, 0.25),
        times, times | st.just(0),
        st.lists(times | st.just(0), min_size=4, max_size=4), st.integers(1, 400),
    )  # fmt: skip
    @example('mean', 1.5, 0.15, 40 * MS, 0, [0, 0, 0, 0], 10)
    @example('mean', 1.5, 0.17, 30 * MS, 0, [0, 0, 0, 0], 10)
    def check(name, speed, length, delay, jump, moves, size):
        line = make_line((0.1, 0.1), speed=speed, length=length, spacing=0.5, after=0.7)
        moved = {each: edge.stamp + delay for each, edge in enumerate(line.edges())}
        for each, move in enumerate(moves):
            moved[each] += move
        edges = [EyeEdge(moved[n], edge.eye, edge.blocked) for n, edge in enumerate(line.edges())]
        middle = line.products[0].t2
        blocks = [
            SampleBlock(b.stamp + jump * (b.stamp > middle), b.first_index, b.counts)
            for b in line.blocks(size)
        ]
        came = [(b.stamp + len(b.counts) * NANOSECONDS // 960, n, b) for n, b in enumerate(blocks)]
        came += [(e.stamp, -1 - n, e) for n, e in enumerate(edges)]
        segmenter = Segmenter(line.load_cell, SegmenterParameters(), 0, failures)
        windows = run_segmenter(
            segmenter, [event for *_, event in sorted(came, key=lambda c: c[:2])]
        )
        assert len({window.item_id for window in windows}) == len(windows) >= 1
        identifier = Identifier(IdentifierParameters(estimator=name), failures=failures)
        estimates = identifier.estimate_all(denoiser.denoise_all(windows))
        assert [estimate.item_id for estimate in estimates] == [w.item_id for w in windows]

    check()

    assert failed == []

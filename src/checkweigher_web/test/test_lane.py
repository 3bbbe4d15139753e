# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the page knows of a lane, on the records of a simulated line."""

from dataclasses import replace

from lines import simulated
import numpy as np
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, Decision, Eye, EyeEdge, Reference, Verdict
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web.lane import MAX_ITEMS, Lane
from checkweigher_web.raw_signal import longest_gap


@pytest.fixture(scope='module')
def recording() -> Recording:
    return simulated(count=3, seed=4)


@pytest.fixture
def lane(recording: Recording) -> Lane:
    return lane_of(recording)


def test_items_have_estimate_reference_and_t4_the_latest_first(lane: Lane, recording: Recording):
    items = lane.items()
    assert [item.verdict.item_id for item in items] == [3, 2, 1]
    results = weigh(recording, LineParameters())
    for item, result in zip(items, reversed(results), strict=True):
        assert item.estimate == result.estimate
        assert item.t4 == result.t4 is not None
        assert item.reference == result.reference > 0


def test_a_fault_without_a_window_shows_the_samples_around_it(lane: Lane, recording: Recording):
    first = [edge.stamp for edge in recording.edges[:4]]
    fault = Verdict(9, first[2] + 1, Decision.FAULT, ('MissingEdge',), t1=first[0])
    lane.take(fault)
    item = lane.with_signals(lane.items()[0])
    assert item.verdict == fault
    assert [edge.stamp for edge in item.stretch.edges] == first
    period = NANOSECONDS / recording.load_cell.sample_rate
    assert np.diff(item.stretch.time) == pytest.approx(period, abs=1)
    assert item.stretch.time[0] < first[0] < first[-1] < item.stretch.time[-1]


def test_numbers_that_begin_again_do_not_mix_items(lane: Lane):
    old = lane.items()[-1]
    again = replace(old.verdict, t1=1, t3=2, mass=9.0)
    lane.take(again)
    assert lane.items()[0].estimate is None
    assert lane.items()[-1] == old


def test_the_empty_belt_is_the_longest_time_without_an_item(lane: Lane, recording: Recording):
    force = lane.empty_belt()
    cell = recording.load_cell
    # The simulation leads in with 2 s.
    assert len(force) / cell.sample_rate == pytest.approx(2, abs=0.2)
    assert np.std(force) < 0.01


def test_the_longest_gap_begins_when_an_item_has_left():
    enters, leaves = (10, Eye.INFEED, True), (40, Eye.OUTFEED, False)
    between = (20, Eye.INFEED, False), (30, Eye.OUTFEED, True)
    passes = [EyeEdge(*edge) for edge in (enters, *between, leaves)]
    assert longest_gap(passes, 0, 100) == (40, 100)
    assert longest_gap(passes, 0, 45) == (0, 10)
    # An item that has not left yet: the belt is not empty.
    assert longest_gap(passes[:1], 0, 100) == (0, 10)


def test_what_is_kept_is_bounded():
    lane = Lane('a')
    for number in range(MAX_ITEMS + 100):
        lane.take(Verdict(number, 2 * number, Decision.FAULT, t1=number))
        lane.take(Reference(number, 0.1))
    assert len(lane.items()) == MAX_ITEMS


def test_signals_are_forgotten_when_nobody_looks(lane: Lane):
    lane.forget_signals()
    assert not len(lane.empty_belt())
    assert len(lane.items()) == 3

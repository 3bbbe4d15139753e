# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of a lane on the page, from a simulated line."""

from dataclasses import replace

from lines import simulated
import numpy as np
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import Recording
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    Reference,
    SampleBlock,
    Verdict,
)
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web.drawing import row_key
from checkweigher_web.history import history_of, intervals
from checkweigher_web.lane import MAX_ITEMS, BeltNoise, Deed, Lane
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


def test_the_items_per_minute_are_those_of_the_latest_items(lane: Lane):
    times = np.array([item.verdict.t1 for item in lane.items()])
    assert lane.throughput() == pytest.approx(60 * NANOSECONDS / np.median(-np.diff(times)))
    assert lane.last_estimate() == lane.items()[0].estimate
    empty = Lane('')
    assert np.isnan(empty.throughput())
    assert empty.last_estimate() is None


def test_the_usual_standard_deviation_is_of_masses_since_the_line_was_started(lane: Lane):
    mass, std_dev = lane.items()[0].estimate.mass, lane.items()[0].estimate.std_dev
    near = [item.estimate for item in lane.items() if abs(item.estimate.mass / mass - 1) < 0.2]
    assert lane.usual_std_dev(mass) == np.median([each.std_dev for each in near]) > 0
    assert lane.usual_std_dev(3 * mass) == 0  # no such mass has passed
    lane.take(lane.load_cell)  # the driver was started again
    assert lane.usual_std_dev(mass) == 0
    lane.take(replace(near[0], std_dev=std_dev))  # without samples, which need a viewer
    assert lane.usual_std_dev(near[0].mass) == std_dev


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
    # The simulation begins with an empty belt for 2 s.
    assert len(force) / cell.sample_rate == pytest.approx(2, abs=0.2)
    assert np.std(force) < 0.01


def test_the_longest_gap_begins_when_an_item_has_left():
    enters, leaves = (10, Eye.INFEED, True), (40, Eye.OUTFEED, False)
    between = (20, Eye.INFEED, False), (30, Eye.OUTFEED, True)
    passes = [EyeEdge(*edge) for edge in (enters, *between, leaves)]
    assert longest_gap(passes, 0, 100) == (40, 100)
    assert longest_gap(passes, 0, 45) == (0, 10)
    # The item has not left yet, so the belt is not empty.
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


def test_an_item_that_comes_again_is_listed_once_and_items_without_times_each(lane: Lane):
    again = lane.items()[0].verdict
    lane.take(again)
    for number in (7, 8):
        lane.take(Verdict(number, None, Decision.FAULT, ('NoEstimate',)))
    items = lane.items()
    assert [item.verdict.item_id for item in items] == [8, 7, 3, 2, 1]
    assert len({row_key(item) for item in items}) == 5


def test_the_history_has_the_items_and_what_was_changed(lane: Lane):
    last = lane.items()[0].verdict
    later = replace(last, item_id=4, t1=last.t1 + NANOSECONDS, t3=last.t3 + NANOSECONDS)
    lane.take(replace(later, product='nuts', lower_limit=0.1))
    lane.take(BeltNoise(5, 0.2))
    lane.take(Deed(later.t3 + 1, 'anna', 'zero'))
    found = lane.history()
    assert found.stamps.tolist() == [item.verdict.t3 for item in reversed(lane.items())]
    assert found.masses == pytest.approx([1e3 * i.verdict.mass for i in reversed(lane.items())])
    assert found.zeros[:3] == pytest.approx([1e3 * i.estimate.zero for i in lane.items()[:0:-1]])
    assert np.isnan(found.zeros[3])
    assert found.noise.tolist() == [[5, 0.2]]
    assert found.changes == ((later.t3, 'product nuts'), (later.t3 + 1, 'anna: zero'))


def test_intervals_have_the_means_of_their_items():
    second = NANOSECONDS
    values = {1: (Decision.ACCEPT, 0.1), 2: (Decision.ACCEPT, 0.3), 3: (Decision.FAULT, np.nan),
              9: (Decision.UNDER, 0.05)}  # fmt: skip
    items = [(Verdict(1, n * second, *each[:1], mass=each[1]), 1e-3) for n, each in values.items()]
    found = intervals(history_of(items), 0, 10 * second, 2)
    assert found.times.tolist() == [2.5 * second, 7.5 * second]
    assert found.rates.tolist() == [3 * 12, 12]
    assert found.rejects == pytest.approx([1 / 3, 1])
    assert found.means == pytest.approx([200, np.nan], nan_ok=True)
    assert found.std_devs == pytest.approx([np.std([100, 300], ddof=1), np.nan], nan_ok=True)
    assert found.zeros == pytest.approx([1, 1])


def test_the_load_has_its_change_within_a_second(recording: Recording):
    lane, cell = Lane('line'), recording.load_cell
    lane.take(cell)
    assert np.isnan(lane.load()).all()
    count = round(cell.sample_rate / 10)  # samples per block
    for number in range(40):
        load = 0.1 if number < 25 else 0.3
        counts = np.full(count, round(cell.zero_counts + load * cell.counts_per_kg), np.int32)
        lane.take(SampleBlock(number * NANOSECONDS // 10, number * count, counts))
        if number == 27:
            assert lane.load()[1] == pytest.approx(0.2, rel=1e-3)
    assert lane.load() == pytest.approx((0.3, 0.0), abs=1e-5)

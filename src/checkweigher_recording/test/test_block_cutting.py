# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import astuple

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_core.block_cutting import cut_for_pace, is_exit, join, join_recording
from checkweigher_core.pacing import Pacer
from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, Reference, SampleBlock
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters

RATE = 1000.0  # Hz
CELL = LoadCell(RATE, 5e5, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)
MILLISECOND = NANOSECONDS // 1000


def block(first, count, stamp=None):
    stamp = first * MILLISECOND if stamp is None else stamp
    return SampleBlock(stamp, first, np.arange(first, first + count, dtype=np.int32))


def edge(milliseconds):
    return EyeEdge(round(milliseconds * MILLISECOND), Eye.OUTFEED, True)


def entry(milliseconds):
    return EyeEdge(round(milliseconds * MILLISECOND), Eye.INFEED, True)


def shown(events):
    """Return events as plain values: (first index, count) of a block, ms of an edge."""
    return [
        (event.first_index, len(event.counts))
        if isinstance(event, SampleBlock)
        else event.stamp / MILLISECOND
        for event in events
    ]


TWO = (block(0, 10), block(10, 10))


@pytest.mark.parametrize(
    ('events', 'longest', 'expected'),
    [
        # A window does not wait for the block in which it ends.
        ([*TWO, edge(13.5), block(20, 10)], 0.03, [(0, 14), 13.5, (14, 16)]),
        # The sample that is taken at the moment of the edge follows it.
        ([*TWO, edge(13), block(20, 10)], 0.03, [(0, 13), 13, (13, 17)]),
        ([*TWO, edge(10), block(20, 10)], 0.03, [(0, 10), 10, (10, 20)]),
        ([*TWO, edge(19.5), block(20, 10)], 0.03, [(0, 20), 19.5, (20, 10)]),
        # Other edges come at once and cut nothing.
        (
            [*TWO, entry(13.5), entry(15), block(20, 10), block(30, 10)],
            0.03,
            [13.5, 15, (0, 30), (30, 10)],
        ),
        ([block(0, 10), edge(2.5), edge(6.5)], 0.01, [(0, 3), 2.5, (3, 4), 6.5, (7, 3)]),
        # A block that is longer than wanted is cut at each edge.
        ([block(0, 100), entry(2.5), entry(6.5)], 0.05, [(0, 3), 2.5, (3, 4), 6.5, (7, 93)]),
        # An edge in a gap comes after the samples before it.
        ([block(0, 10), entry(25), block(40, 10)], 1.0, [(0, 10), 25, (40, 10)]),
    ],
)
def test_blocks_are_cut_at_edges(events, longest, expected):
    assert shown(join(events, RATE, longest, ends_block=is_exit)) == expected


def test_at_full_speed_nothing_ends_a_block_for_nothing_waits_for_it():
    events = [block(0, 10), entry(3.5), block(10, 10), edge(13.5), block(20, 10), block(30, 10)]

    assert shown(cut_for_pace(events, RATE, 0.0, 0.02)) == [3.5, 13.5, (0, 40)]
    assert shown(cut_for_pace(events, RATE, 1.0, 0.02)) == [
        3.5, (0, 14), 13.5, (14, 16), (30, 10)
    ]  # fmt: skip


def test_all_come_in_the_order_in_which_they_are_due():
    simulation = Simulation(SimulationParameters(count=12, samples_per_block=7, seed=4))
    rate = simulation.load_cell.sample_rate
    pacer = Pacer(1.0, rate, 0.0)

    due = [pacer.due(event) for event in cut_for_pace(simulation, rate, 1.0, 0.05)]

    assert len(due) > 100
    # The last sample before t3 is due when it ends, which is after t3.
    assert np.all(np.diff(due) > -1 / rate)


def test_the_parts_of_a_block_have_the_stamps_of_their_first_samples():
    _, _, last = join([block(0, 10), edge(2.5)], 960.0, ends_block=is_exit)

    assert last.first_index == 3
    assert last.stamp == round(3 * NANOSECONDS / 960)


def test_blocks_that_follow_each_other_are_joined():
    events = [block(0, 10), block(10, 10), edge(15), block(20, 10), block(30, 5), edge(36)]

    joined = list(join(events, RATE))

    assert shown(joined) == [15, (0, 35), 36]
    np.testing.assert_array_equal(joined[1].counts, np.arange(35))


@pytest.mark.parametrize(
    'second',
    [block(11, 10), block(9, 10), block(10, 10, stamp=10 * MILLISECOND + 2), block(0, 10)],
    ids=['lost', 'overlapping', 'off the clock', 'again'],
)
def test_blocks_that_do_not_follow_each_other_stay_what_they_are(second):
    assert shown(join([block(0, 10), second], RATE)) == shown([block(0, 10), second])


def test_a_joined_block_is_no_longer_than_the_segmenter_reports():
    events = [block(first, 10) for first in range(0, 1000, 10)]

    assert shown(join(events, RATE)) == [(first, 250) for first in range(0, 1000, 250)]


@pytest.mark.parametrize(
    'ends_block',
    [is_exit, lambda edge: False, lambda edge: True],
    ids=['at t3', 'nowhere', 'at each edge'],
)
def test_the_masses_are_the_same_to_the_last_bit(ends_block):
    simulation = Simulation(SimulationParameters(count=12, samples_per_block=7, seed=4))

    def weighed(events):
        line = WeighingLine(simulation.load_cell, LineParameters())
        results = [
            result
            for event in events
            if not isinstance(event, Reference)
            for result in line.add(event)
        ]
        return [*results, *line.finish()]

    events = list(simulation)
    expected = weighed(events)
    found = weighed(join(events, simulation.load_cell.sample_rate, ends_block=ends_block))

    assert len(expected) == 12
    assert all(result.estimate.weighed for result in expected)
    # Not a number is not equal to itself, its text is.
    assert [repr(astuple(each)) for each in found] == [repr(astuple(each)) for each in expected]


STREAMS = st.lists(
    st.tuples(
        st.integers(0, 4),  # samples in the block
        # What is lost before it, in samples and ms; ns by which its stamp is off the clock.
        st.sampled_from([0, 0, 0, 1, -1, 2**62]),
        st.sampled_from([0, 0, 0, 1, 300]),
        st.sampled_from([0, 0, 0, 1, -1, 2]),
    ),
    max_size=40,
)


def recording_of(blocks, edges):
    events, first, stamp = [], 0, 0
    for count, lost, waited, off in blocks:
        first, stamp = max(first + lost, 0) % 2**64, stamp + waited * MILLISECOND
        counts = np.arange(count, dtype=np.int32)
        events.append(SampleBlock(max(stamp + off, 0), first, counts))
        first, stamp = first + count, stamp + count * MILLISECOND
    events += [EyeEdge(at * MILLISECOND, Eye(at % 2), at % 3 == 0) for at in edges]
    return Recording.from_events(CELL, [*events, Reference(MILLISECOND, 0.1)])


@given(STREAMS, st.lists(st.integers(-2, 100)), st.sampled_from([0.004, 0.01, 0.25]))
def test_a_recording_is_joined_as_its_events_are(blocks, edges, longest):
    recording = recording_of(blocks, edges)

    joined = join_recording(recording, longest)

    signal = (event for event in recording if not isinstance(event, Reference))
    expected = [_plain(event) for event in join(signal, RATE, longest)]
    assert [_plain(event) for event in joined] == expected
    assert len(joined) == len(expected)


def test_the_edges_of_a_long_block_of_a_recording_come_after_it():
    events = [block(0, 100), entry(2.5), edge(6.5), block(100, 10), entry(105)]

    joined = join_recording(Recording.from_events(CELL, events), 0.05)

    assert shown(joined) == [(0, 100), 2.5, 6.5, 105, (100, 10)]


def _plain(event):
    if isinstance(event, SampleBlock):
        return event.stamp, event.first_index, event.counts.tolist()
    return event

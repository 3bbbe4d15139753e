# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Disturbed lines of any kind: each item one window, a named reason, no wrong window as sound."""

from dataclasses import replace
import os

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from synthetic_line import CELL, make_line, reasons_of, run_segmenter

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, SampleBlock
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '300'))
MS = 1_000_000
DEFAULT = SegmenterParameters()
NAMES = ('t1', 't2', 't3', 't4')


def _run(line, events, **parameters):
    windows = run_segmenter(Segmenter(line.load_cell, SegmenterParameters(**parameters)), events)
    assert sorted(w.item_id for w in windows) == list(range(1, len(windows) + 1))
    return sorted(windows, key=lambda window: window.item_id)


def _shift(line, after, delay):
    """Move all edges later than `after` by `delay`: the belt stood still, or was slower."""
    return sorted(
        (replace(e, stamp=e.stamp + delay) if e.stamp > after else e for e in line.edges()),
        key=lambda edge: edge.stamp,
    )


LOST = [(1, 't2'), (1, 't3'), (1, 't4'), (2, 't1')]


def test_four_edges_lost_between_two_items_do_not_make_a_slow_one():
    line = make_line((0.1,) * 5)

    assert reasons_of(_run(line, line.events(LOST))) == [[], ['BeltStopped'], [], []]


def test_nor_before_any_speed_is_known_if_the_recipe_has_the_length():
    line = make_line((0.1,) * 4)
    lost = [(number - 1, name) for number, name in LOST]

    assert _run(line, line.events(lost), product_length=0.1)[0].reasons == ('ProductTooLong',)


@pytest.mark.parametrize(
    ('length', 'width', 'reason'),
    [
        (0.1, 0.0, None),
        (0.109, 0.0, None),
        (0.112, 0.0, 'ProductTooLong'),
        (0.088, 0.0, 'ProductTooShort'),
        (0.112, 0.06, 'ProductAskew'),  # the diagonal is 0.117 m
        (0.128, 0.06, 'ProductTooLong'),
        (0.06, 0.06, 'ProductAskew'),  # lies across
        (0.048, 0.06, 'ProductTooShort'),
    ],
)
def test_the_length_is_that_of_the_recipe(length, width, reason):
    line = make_line((0.1,), length=length)

    windows = _run(line, line.events(), product_length=0.1, product_width=width)

    assert reasons_of(windows) == [[reason] if reason else []]


@pytest.mark.parametrize(
    ('speeds', 'reasons'),
    [
        ([1.0, 1.19, 1.0], [[], [], []]),
        ([1.0, 1.3, 1.3, 1.3], [[], ['BeltSpeedChanged'], [], []]),
        ([1.0, 0.6, 1.0, 1.0], [[], ['BeltSpeedChanged'], [], []]),
        ([1.0, 0.4, 0.4], [[], ['BeltStopped'], []]),
    ],
)
def test_another_belt_speed_costs_one_item(speeds, reasons):
    events, start = [], make_line().start
    segmenter = Segmenter(make_line().load_cell, DEFAULT)
    first = 0
    for speed in speeds:
        line = make_line((0.1,), speed=speed, start=start)
        events += [
            replace(e, first_index=e.first_index + first) if isinstance(e, SampleBlock) else e
            for e in line.events()
        ]
        start, first = line.stamp_at(len(line.counts)), first + len(line.counts)

    assert reasons_of(run_segmenter(segmenter, events)) == reasons


@pytest.mark.parametrize(
    ('moment', 'seconds', 'reason'),
    [('t1', 1, 'BeltStopped'), ('t2', 1, 'BeltStopped'), ('t1', 4, 'MissingEdge')],
)
def test_a_belt_that_stops_during_a_pass_costs_what_was_on_it(moment, seconds, reason):
    line = make_line((0.1,) * 5, after=12.0)
    edges = _shift(line, getattr(line.products[1], moment), seconds * NANOSECONDS)

    assert reasons_of(_run(line, line.events(edges=edges))) == [[], [reason], [], [], []]


def test_a_product_that_rides_back_over_the_infeed_eye_is_a_fault():
    line = make_line((0.1, 0.1))
    t2 = line.products[1].t2
    back = [EyeEdge(t2 + 20 * MS, Eye.INFEED, True), EyeEdge(t2 + 60 * MS, Eye.INFEED, False)]

    windows = _run(line, line.events(edges=[*line.edges(), *back]))

    assert not windows[0].reasons
    assert all('DistanceFault' in window.reasons for window in windows[1:])


def test_a_product_taken_off_first_is_passed_over_if_the_length_is_known():
    line = make_line((0.1,) * 5)
    windows = _run(line, line.events([(0, 't3'), (0, 't4')]), product_length=0.1)

    assert reasons_of(windows) == [['MissingEdge'], [], [], [], []]


@pytest.mark.parametrize('before', [('t1',), ('t1', 't2')])
def test_a_product_on_the_belt_at_start_up_is_a_fault(before):
    # An eye that reports its state when it starts, instead of the edge.
    line = make_line((0.1, 0.1), first_entry=-0.05 if before == ('t1',) else -0.12)
    edges = list(line.edges([(0, name) for name in before]))
    if before == ('t1',):
        edges.append(EyeEdge(line.start, Eye.INFEED, True))

    windows = _run(line, line.events(edges=edges))

    assert 'StartUp' in windows[0].reasons
    assert not windows[1].reasons
    assert windows[1].zero == pytest.approx(5000.0, abs=1e-3)  # not what was leaving


def test_edges_that_overtake_one_another_before_their_samples_do_no_harm():
    line = make_line()
    assert _run(line, [*reversed(line.edges()), *line.blocks()]) == _run(line, line.events())


@pytest.mark.parametrize('name', NAMES)
def test_an_edge_that_comes_after_younger_ones_costs_at_most_its_item_and_the_next(name):
    line = make_line((0.1,) * 4)
    late = line.products[1].edges[name]
    events = [event for event in line.events() if event != late]
    younger = {'t1': 't2', 't2': 't3', 't3': 't4', 't4': None}[name]
    after = line.products[1].edges[younger] if younger else line.products[2].edges['t1']
    last = max(i for i, event in enumerate(events) if event.stamp <= after.stamp) + 2
    events.insert(last, late)

    windows = _run(line, events)

    assert len(windows) == 4
    assert bool(windows[1].reasons) == (name != 't4')
    assert not windows[0].reasons
    assert not windows[3].reasons


def test_samples_that_never_come_are_a_fault_and_not_a_silence():
    line = make_line((0.1,) * 30)
    segmenter = Segmenter(CELL, SegmenterParameters(sample_lateness=1.0))

    windows = [window for edge in line.edges() for window in segmenter.take(edge)]

    assert reasons_of(windows)[:20] == [['SamplesLost']] * 20


def _blocks_with(line, change):
    """Hand each block from the middle of the second item on to `change`."""
    middle = line.products[1].t2 + 50 * MS
    return [
        change(event) if isinstance(event, SampleBlock) and event.stamp > middle else event
        for event in line.events()
    ]


def test_a_jump_of_the_index_without_the_time_is_a_fault():
    line = make_line((0.1,) * 4)
    events = _blocks_with(line, lambda b: replace(b, first_index=b.first_index + 96))

    assert reasons_of(_run(line, events)) == [[], ['ClockJump'], [], []]


@pytest.mark.parametrize('jump', [1, -1])
def test_a_jump_of_the_time_without_the_index_is_a_fault(jump):
    line = make_line((0.1,) * 4)
    middle = line.products[1].t2 + 50 * MS
    events = [
        replace(event, stamp=event.stamp + jump * NANOSECONDS) if event.stamp > middle else event
        for event in line.events()
    ]

    reasons = reasons_of(_run(line, events))

    assert reasons[0] == []
    assert reasons[1] == ['ClockJump']
    assert reasons[-2:] == [[], []]


@pytest.mark.parametrize('change', ['twice', 'swapped', 'late'])
def test_blocks_twice_do_nothing_and_swapped_or_late_ones_are_lost(change):
    line = make_line((0.1,) * 3)
    events = line.events()
    t2 = line.products[1].t2
    hit, *later = (i for i, e in enumerate(events) if isinstance(e, SampleBlock) and e.stamp > t2)
    events.insert(later[{'twice': 3, 'swapped': 0, 'late': 10}[change]] + 1, events[hit])
    if change != 'twice':
        del events[hit]

    lost = [] if change == 'twice' else ['SamplesLost']
    assert reasons_of(_run(line, events)) == [[], lost, []]


@pytest.mark.parametrize('duration', [1.0, 30.0])  # within what is kept of the signal, and beyond
def test_a_recording_played_in_a_loop_starts_again_each_time(duration):
    line = make_line((0.1, 0.2), first_entry=3.0, after=duration)
    events = line.events()
    # The second time it is broken off with the second product on the belt.
    begun = [event for event in events if event.stamp <= line.products[1].t2]

    windows = _run(line, [*events, *begun, *events])

    whole = [[], []]
    assert reasons_of(windows) == [*whole, [], ['SourceRestarted'], *whole]
    for first, last in zip(windows[:2], windows[4:], strict=True):
        # The zero is followed on: of it alone more is known.
        assert np.array_equal(last.counts, first.counts)
        assert (last.t1, last.t3, last.first_index) == (first.t1, first.t3, first.first_index)
        assert last.zero == pytest.approx(first.zero, abs=1e-9)


FIRST_EDGES = [(number, name) for number in range(3) for name in NAMES]


@pytest.mark.parametrize(
    'lost',
    [
        [(0, 't3'), (0, 't4')],  # taken off
        [(0, 't2'), (0, 't3')],
        [(0, 't3'), (1, 't2')],
    ],
)
def test_after_a_start_with_lost_edges_the_second_whole_product_is_weighed(lost):
    line = make_line((0.1,) * 8)

    weighed = {window.t3 for window in _run(line, line.events(lost)) if not window.reasons}
    whole = [p for n, p in enumerate(line.products) if n > lost[-1][0]]
    assert {product.t3 for product in whole[1:]} <= weighed


@given(st.sets(st.sampled_from(FIRST_EDGES)), st.sampled_from([0.35, 0.5, 0.8]))
@settings(max_examples=max(EXAMPLES // 10, 20), deadline=None)
def test_no_edges_that_were_lost_at_the_start_keep_a_steady_feed_from_being_weighed(lost, spacing):
    line = make_line((0.1,) * 8, spacing=spacing)

    weighed = {window.t3 for window in _run(line, line.events(lost)) if not window.reasons}
    assert {product.t3 for product in line.products[-2:]} <= weighed


def test_two_products_that_are_always_on_the_belt_at_once_stay_faults():
    line = make_line((0.1,) * 8, spacing=0.15)

    assert all(window.reasons for window in _run(line, line.events([(0, 't3'), (0, 't4')])))

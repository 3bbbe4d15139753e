# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Blocks of any size, in any interleaving with the edges, give the same windows."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from synthetic_line import cut, make_line, reasons_of, run_segmenter

from checkweigher_core.records import NANOSECONDS, EyeEdge
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

LATENESS = 0.3
BELATED = SegmenterParameters(edge_lateness=LATENESS, min_belt_speed=0.25, lead_time=0.2)
LOST_EDGES = st.sets(
    st.tuples(st.integers(0, 3), st.sampled_from(['t1', 't2', 't3', 't4'])), max_size=3
)
LOST_SAMPLES = st.just((0, 0)) | st.integers(1, 2500).flatmap(
    lambda begin: st.tuples(st.just(begin), st.integers(begin, begin + 200))
)


def _item_id(window):
    return window.item_id


def _same(windows, expected):
    """Compare all but the last nanosecond of the first stamp: that of a block is rounded."""
    assert len(windows) == len(expected)
    for window, other in zip(windows, expected, strict=True):
        assert abs(window.stamp - other.stamp) <= 1
        assert replace(window, stamp=0) == replace(other, stamp=0)


def _interleave(blocks, edges, edges_first, line, lateness=LATENESS):
    """Merge both streams, each in its order, with no edge later than allowed."""
    blocks, edges, events = list(blocks), list(edges), []
    while blocks or edges:
        if blocks and edges:
            last = line.stamp_at(blocks[0].first_index + len(blocks[0].counts) - 1)
            due = last > edges[0].stamp + lateness * NANOSECONDS
            edge_next = due or edges_first(len(events))
        else:
            edge_next = bool(edges)
        events.append((edges if edge_next else blocks).pop(0))
    return events


@settings(max_examples=100)
@given(st.data())
def test_neither_blocks_nor_interleaving_change_a_window(data):
    line = make_line(
        (0.1, 0.2, 0.3, 0.15),
        speed=data.draw(st.sampled_from([0.5, 1.0, 1.37])),
        spacing=data.draw(
            st.lists(st.sampled_from([0.15, 0.25, 0.42, 0.6]), min_size=3, max_size=3)
        ),
    )
    line.counts[::7] += 3
    without, lost = data.draw(LOST_EDGES), data.draw(LOST_SAMPLES)
    parameters = replace(BELATED, trail_time=data.draw(st.sampled_from([0.0, 0.05, 1.0])))
    expected = run_segmenter(
        Segmenter(line.load_cell, parameters), line.events(without, size=16, lost=lost)
    )
    cuts = data.draw(st.sets(st.integers(0, len(line.counts)), max_size=40))
    choices = data.draw(st.lists(st.booleans(), min_size=64, max_size=64))
    events = _interleave(
        line.blocks(cuts=cuts, lost=lost),
        line.edges(without),
        lambda n: choices[n % len(choices)],
        line,
    )

    windows = run_segmenter(Segmenter(line.load_cell, parameters), events)

    _same(sorted(windows, key=_item_id), sorted(expected, key=_item_id))


@pytest.mark.parametrize('order', ['samples first', 'edges first'])
def test_one_whole_stream_may_come_before_the_other(order):
    # All samples first: the first edge is then late by less than edge_lateness.
    line = make_line()
    parameters = SegmenterParameters(edge_lateness=5.0)
    expected = cut(line, parameters)
    samples, edges = line.blocks(size=10**6), line.edges()

    windows = cut(
        line, parameters, samples + edges if order == 'samples first' else edges + samples
    )

    assert reasons_of(expected) == [[], [], []]
    _same(windows, expected)


def test_all_edges_may_be_as_late_as_allowed_through_a_long_run():
    # The samples from zero_time before t1 on must still be there, wherever the ring stands.
    line = make_line((0.1,) * 20, spacing=0.53)
    line.counts[::7] += 3
    parameters = SegmenterParameters(
        edge_lateness=0.5, lead_time=0.15, zero_time=0.05, min_belt_speed=0.99
    )
    expected = cut(line, parameters, size=1)

    blocks = line.blocks(size=8)
    events = _interleave(blocks, line.edges(), lambda _: False, line, lateness=0.5)
    windows = cut(line, parameters, events)

    assert reasons_of(expected) == [[]] * 20
    _same(windows, expected)


def test_an_edge_after_t3_changes_no_window_however_early_it_comes():
    # The infeed eye flickers again after the product has begun to leave.
    line = make_line((0.1,), length=0.17)
    parameters = SegmenterParameters(debounce_time=0.05)
    t2 = line.products[0].edges['t2']
    flicker = replace(t2, stamp=t2.stamp + 40_000_000, blocked=True)
    edges = sorted([*line.edges(), flicker], key=lambda edge: edge.stamp)
    expected = cut(line, parameters, [*line.blocks(10**6), *edges])

    windows = cut(line, parameters, [*edges, *line.blocks()])

    assert reasons_of(expected) == [[]]
    _same(windows, expected)


def test_edges_at_one_and_the_same_time_are_faults_and_stop_nothing():
    at_once = [
        EyeEdge(5, eye, blocked)
        for eye, blocked in ((0, False), (0, True), (0, False), (1, True), (1, False))
    ]
    unseen = EyeEdge(NANOSECONDS, 1, True)

    windows = cut(make_line(), events=[*at_once, unseen])

    assert len(windows) == 2
    assert all(window.reasons for window in windows)
    assert np.isnan(windows[1].line_speed)

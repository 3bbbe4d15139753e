# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weigh windows: where they begin and end, and why there is none."""

from dataclasses import replace
import math

import numpy as np
import pytest
from synthetic_line import CELL, MILLI, cut, make_line, reasons_of, run_segmenter

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

DEFAULT = SegmenterParameters()


@pytest.mark.parametrize(
    ('entry', 'begin', 'end'),
    [
        (1.0, 1100, 1200),  # t2 at sample 1100 itself, t3 at 1200 itself
        (1.0005, 1101, 1201),  # t2 = 1.1005 s, t3 = 1.2005 s
        (0.9999, 1100, 1200),  # just before
        (1.0001, 1101, 1201),  # just after
    ],
)
def test_a_window_begins_at_or_after_t2_and_ends_before_t3(entry, begin, end):
    line = make_line((0.2,), first_entry=entry, load_cell=MILLI)

    (window,) = cut(line)

    assert window.first_index + window.window_begin == begin
    assert window.first_index + window.window_end == end
    # lead_time 0.5 s before t1, which is 0.1 s before t2.
    assert window.window_begin == 600
    np.testing.assert_array_equal(window.counts, line.counts[begin - 600 : end])


@pytest.mark.parametrize(
    ('spacing', 'lost', 'first', 'empty_begin'),
    [
        (0.6, [], 1100, 200),  # t1 = 1.6 s, the first one left at 1.3 s
        (0.35, [], 850, 450),  # t1 = 1.35 s
        (0.8, [], 1300, 0),
        (2.0, [], 2500, 0),
        (0.6, [(0, 't4')], 1100, 300),  # at the latest: twice its length after t3 = 1.2 s
    ],
)
def test_a_window_has_its_time_and_from_when_on_the_belt_was_empty(
    spacing, lost, first, empty_begin
):
    line = make_line((0.2, 0.1), spacing=spacing, load_cell=MILLI)

    windows = cut(line, without=lost)

    # 0.5 s before t1; before the first item the eyes have seen nothing leave.
    assert [window.first_index for window in windows] == [500, first]
    assert [window.stamp - line.start for window in windows] == [500_000_000, first * 1_000_000]
    assert [window.empty_begin for window in windows] == [0, empty_begin]


@pytest.mark.parametrize(
    ('spacing', 'lost', 'empty_begin'),
    [
        (0.25, [], 550),  # it left at 1.3 s, which is 0.05 s after the second one began to enter
        (0.32, [(0, 't4')], 580),  # at the latest: twice its length after t3 = 1.2 s
    ],
)
def test_an_item_that_enters_while_another_leaves_is_alone_later(spacing, lost, empty_begin):
    second = cut(make_line((0.2, 0.1), spacing=spacing, load_cell=MILLI), without=lost)[1]

    assert second.reasons == ()
    assert (second.empty_begin, second.window_begin) == (empty_begin, 600)


def test_what_the_eyes_tell_stands_in_the_window():
    line = make_line((0.2,), speed=0.8, length=0.12)
    product = line.products[0]

    (window,) = cut(line)

    assert (window.item_id, window.reasons) == (1, ())
    assert (window.t1, window.t2, window.t3) == (product.t1, product.t2, product.t3)
    assert window.belt_speed == pytest.approx(0.8, rel=1e-8)  # stamps are rounded to 1 ns
    assert window.product_length == pytest.approx(0.12, rel=1e-8)
    assert window.line_speed == window.belt_speed
    assert (window.sample_rate, window.counts_per_kg, window.zero_counts) == (960.0, 1e6, 5000.0)
    assert len(window.denoised) == 0


@pytest.mark.parametrize('spacing', [0.42, 0.6, 2.0])
def test_the_zero_is_read_from_the_empty_belt_alone(spacing):
    line = make_line((0.2, 0.1, 0.3), spacing=spacing)
    drifted = replace(CELL, zero_counts=4000.0)  # the belt reads 5000 without noise

    for window in cut(replace(line, load_cell=drifted)):
        # The least noise that the filter reckons with is 1e-8 of the variance it began with.
        assert window.zero == pytest.approx(5000.0, abs=1e-4)
        assert window.zero_counts == 4000.0
        assert window.force[window.window_begin :] == pytest.approx(
            line.products[window.item_id - 1].mass, abs=1e-9
        )


def test_where_no_empty_belt_was_seen_the_zero_is_carried_on():
    line = make_line((0.2, 0.1), spacing=0.32)  # 0.02 s between two, less than zero_moment
    drifted = replace(line, load_cell=replace(CELL, zero_counts=4000.0))

    first, second = cut(drifted, SegmenterParameters(zero_random_walk=1e-3, zero_drift=0.0))

    assert second.zero == first.zero
    # 1000 counts per square root of a second, for 0.32 s.
    assert second.zero_std_dev == pytest.approx(
        math.sqrt(first.zero_std_dev**2 + 0.32 * 1000**2), rel=1e-6
    )


@pytest.mark.parametrize('lost', ['t1', 't2', 't3'])
def test_a_missing_edge_is_a_fault_without_signal_at_the_speed_of_the_line(lost):
    window = cut(make_line(speed=0.8), without=[(1, lost)])[1]

    assert 'MissingEdge' in window.reasons
    assert getattr(window, lost) is None
    assert len(window.counts) == 0
    assert math.isnan(window.zero)
    assert math.isnan(window.belt_speed) == (lost != 't2')
    assert lost == 't3' or window.line_speed == pytest.approx(0.8, rel=1e-8)


# The first product is on the belt from sample 960 (t1) over 1056 (t2) to 1152 (t3).
@pytest.mark.parametrize(
    ('lost', 'reasons'),
    [
        ((1100, 1101), ['SamplesLost']),
        ((960, 970), ['SamplesLost']),
        ((1151, 1160), ['SamplesLost']),
        ((1000, 1300), ['SamplesLost']),
        ((950, 960), []),
        ((1152, 1200), []),
        ((1056, 1056), []),
    ],
)
def test_samples_lost_between_t1_and_t3_are_a_fault(lost, reasons):
    assert reasons_of(cut(make_line(), lost=lost)) == [reasons, [], []]


def test_lost_samples_before_the_item_shorten_what_goes_with_it():
    line = make_line()

    window = cut(line, lost=(900, 950))[0]

    assert (window.first_index, window.window_begin) == (950, 1056 - 950)
    assert window.stamp == line.stamp_at(950)
    np.testing.assert_array_equal(window.counts, line.counts[950:1152])


@pytest.mark.parametrize(
    ('index', 'reasons'), [(1100, ['Saturation']), (1000, ['Saturation']), (959, []), (1152, [])]
)
@pytest.mark.parametrize('limit', ['min_counts', 'max_counts'])
def test_a_reading_at_the_limit_of_the_converter_is_a_fault(index, reasons, limit):
    line = make_line()
    line.counts[index] = getattr(CELL, limit)

    assert reasons_of(cut(line)) == [reasons, [], []]


def test_one_count_within_the_limit_is_no_saturation():
    line = make_line()
    line.counts[1100:1102] = CELL.max_counts - 1, CELL.min_counts + 1

    assert reasons_of(cut(line)) == [[], [], []]


@pytest.mark.parametrize(
    ('values', 'cell', 'name'),
    [
        ({'min_belt_speed': 1e-3}, {'weigh_length': 100.0}, 'min_belt_speed: .*raise it'),
        ({'lead_time': 60.0}, {'sample_rate': 1e4}, 'lead_time: .*lower it'),
        ({'trail_time': 60.0, 'min_belt_speed': 0.01}, {'sample_rate': 1e4}, 'min_belt_speed: '),
        ({'edge_lateness': 60.0, 'min_belt_speed': 2.0}, {'sample_rate': 5e4}, 'edge_lateness: '),
    ],
)
def test_windows_that_would_be_too_long_are_refused_before_the_first(values, cell, name):
    with pytest.raises(ParameterError, match=f'segmenter.{name}'):
        Segmenter(replace(CELL, **cell), SegmenterParameters(**values))


@pytest.mark.parametrize(('capacity', 'reasons'), [(0.25, ['Overload']), (0.31, [])])
@pytest.mark.parametrize('sign', [1, -1])
def test_a_load_above_the_capacity_is_a_fault(capacity, reasons, sign):
    cell = replace(CELL, counts_per_kg=sign * CELL.counts_per_kg, capacity=capacity)

    assert reasons_of(cut(make_line(load_cell=cell))) == [[], [], reasons]


@pytest.mark.parametrize(('least', 'reasons'), [(96, []), (97, ['WindowTooShort'])])
def test_a_window_of_fewer_samples_than_allowed_is_a_fault(least, reasons):
    # (0.2 - 0.1) m at 1 m/s are 96 samples.
    assert reasons_of(cut(make_line(), SegmenterParameters(min_window=least))) == [reasons] * 3


@pytest.mark.parametrize(
    ('line', 'reasons'),
    [
        ({'length': 0.004}, ['ProductTooShort']),
        ({'length': 0.2}, ['ProductTooLong']),
        ({'length': 0.3}, ['ProductTooLong', 'MissingEdge']),
        ({'speed': 3.1}, ['BeltSpeed']),
        ({'speed': 0.09, 'spacing': 1.0, 'after': 30.0}, ['MissingEdge']),
    ],
    ids=str,
)
def test_what_is_no_product_of_this_line_is_one_fault(line, reasons):
    # An item that is slower than the slowest belt is given up before it leaves.
    windows = cut(make_line(**line), SegmenterParameters(debounce_time=0.001))

    assert [window.reasons[: len(reasons)] for window in windows] == [tuple(reasons)] * 3


@pytest.mark.parametrize('seen', [1, 2])
def test_what_is_on_the_belt_when_the_stream_ends_is_a_fault(seen):
    line = make_line((0.1,))
    segmenter = Segmenter(CELL, DEFAULT)

    windows = run_segmenter(segmenter, [line.blocks(1100)[0], *line.edges()[:seen]])

    assert reasons_of(windows) == [['StreamEnded']]
    assert segmenter.finish() == []


def test_a_restart_of_the_source_costs_the_item_on_the_belt():
    before = make_line((0.1,))
    after = make_line((0.2,), start=before.start + 20 * NANOSECONDS)
    begun = [event for event in before.events() if event.stamp < before.products[0].t2 + 1]

    windows = cut(before, events=begun + after.events())

    assert reasons_of(windows) == [['SourceRestarted'], []]
    # Indices count from the restart.
    assert windows[1].first_index + windows[1].window_end == 1152


def test_items_are_counted_on_from_those_that_were_there_before():
    line = make_line()
    segmenter = Segmenter(line.load_cell, DEFAULT, item_count=41)

    assert [window.item_id for window in run_segmenter(segmenter, line.events())] == [42, 43, 44]
    assert (segmenter.item_count, segmenter.cutter.count, segmenter.edges) == (44, 3, 12)
    assert segmenter.samples == len(line.counts)

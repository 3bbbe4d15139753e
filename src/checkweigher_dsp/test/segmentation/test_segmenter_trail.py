# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a window holds of the signal after t3."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_line import MILLI, cut, make_line

from checkweigher_core.records import NANOSECONDS
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter


@pytest.fixture(scope='module')
def line():
    """Return a sample each millisecond; t1 = 1.0 s, t2 = 1.1 s, t3 = 1.2 s, t4 = 1.3 s."""
    return make_line((0.2,), load_cell=MILLI)


def _trailing(trail_time, **values):
    return SegmenterParameters(trail_time=trail_time, **values)


@pytest.mark.parametrize(
    ('trail_time', 'count'),
    # No later than t4, when the item has left.
    [(0.0, 0), (0.001, 1), (0.05, 50), (0.1, 100), (0.101, 100), (5.0, 100)],
)
def test_a_window_holds_what_was_waited_for_after_t3(line, trail_time, count):
    (window,) = cut(line, _trailing(trail_time))

    assert len(window.counts) - window.window_end == count
    assert window.first_index + window.window_end == 1200
    np.testing.assert_array_equal(window.counts, line.counts[500 : 1200 + count])


def test_but_for_what_follows_t3_a_window_is_as_it_was(line):
    (short,) = cut(line, _trailing(0.0))

    (long,) = cut(line, _trailing(0.05))

    assert replace(long, counts=long.counts[: long.window_end]) == short


def test_a_window_comes_when_its_trail_is_complete_and_not_before(line):
    segmenter = Segmenter(line.load_cell, _trailing(0.05))
    for edge in line.edges():
        segmenter.take(edge)

    came = [block.first_index for block in line.blocks(size=1) for _ in segmenter.take(block)]

    assert came == [1249]


@pytest.mark.parametrize(('index', 'count'), [(1200, 0), (1249, 0), (1250, 50)])
@pytest.mark.parametrize('spoilt', ['lost', 'min_counts', 'max_counts'])
def test_a_trail_with_lost_or_saturated_samples_is_left_out_and_the_item_weighed(
    line, index, count, spoilt
):
    counts, lost = line.counts.copy(), (index, index + 10)
    if spoilt != 'lost':
        counts[index], lost = getattr(line.load_cell, spoilt), (0, 0)
    (window,) = cut(line, _trailing(0.05), replace(line, counts=counts).events(lost=lost))

    assert window.reasons == ()
    np.testing.assert_array_equal(window.counts, counts[500 : 1200 + count])


@pytest.mark.parametrize(
    ('end', 'reasons'), [(1199, ('StreamEnded',)), (1200, ()), (1201, ()), (1249, ())]
)
def test_the_end_of_the_stream_after_t3_cuts_the_trail_short(line, end, reasons):
    (block,) = line.blocks(cuts=[end])[:1]

    (window,) = cut(line, _trailing(0.05), [block, *line.edges()[:3]])

    assert window.reasons == reasons
    np.testing.assert_array_equal(window.counts, [] if reasons else line.counts[500:end])


def test_a_restart_of_the_source_cuts_the_trail_short_and_the_item_is_weighed(line):
    (block,) = line.blocks(cuts=[1220])[:1]
    after = make_line((0.1,), start=line.start + 20 * NANOSECONDS, load_cell=line.load_cell)

    windows = cut(line, _trailing(0.05), [block, *line.edges()[:3], *after.events()])

    assert [window.reasons for window in windows] == [(), ()]
    np.testing.assert_array_equal(windows[0].counts, line.counts[500:1220])


@pytest.mark.parametrize('entry', [2.05, 2.11, 2.2, 2.5, 2.95])
@pytest.mark.parametrize('trail_time', [0.0, 1.0, 1.8])
def test_what_goes_with_a_window_is_kept_while_its_trail_is_waited_for(line, entry, trail_time):
    # 2 s from eye to eye, then nearly as long until the item has left; a memory for no more than
    # that, and blocks of 1 s.
    short = {'lead_time': 0.01, 'zero_time': 0.0, 'min_belt_speed': 0.099, 'edge_lateness': 0.0}
    parameters = _trailing(trail_time, **short)
    belt = {'speed': 0.1, 'load_cell': line.load_cell}
    slow = make_line((0.2, 0.1), length=0.19, spacing=0.4, first_entry=entry, **belt)

    fine = cut(slow, parameters, slow.events(size=20))
    coarse = cut(slow, parameters, [*slow.edges(), *slow.blocks(size=1000)])

    assert [window.reasons for window in fine] == [(), ()]
    assert coarse == fine

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The zero on a running line: limits, zeroing on demand, dense products on a drifting cell."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_line import CELL, feed, make_line

from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

CAREFUL = SegmenterParameters(zero_range=0.003, zero_time=0.5)


@pytest.mark.parametrize(('calibrated', 'reasons'), [(2100.0, ()), (1900.0, ('ZeroOutOfRange',))])
def test_beyond_the_range_every_item_is_a_fault(calibrated, reasons):
    # The belt reads 5000; the range is 3000 counts.
    segmenter = Segmenter(replace(CELL, zero_counts=calibrated), CAREFUL)

    assert [window.reasons for window in feed(segmenter, make_line().events())] == [reasons] * 3


def test_an_idle_belt_is_zeroed_on_demand():
    segmenter = Segmenter(replace(CELL, zero_counts=4000.0), CAREFUL)
    line = make_line((0.1,), first_entry=8.0)
    segmenter.zero_keeper.request()

    feed(segmenter, [event for event in line.events() if event.stamp < line.start + 5 * 10**9])

    answer = segmenter.zero_keeper.answer
    assert answer.change
    assert 'zeroed at 0.001000 kg' in answer.text
    change = answer.change
    # It reads 5000 counts of 1e-6 kg; it was calibrated, and not corrected since, at 4000.
    assert (change.zero, change.previous) == pytest.approx((1e-3, 0.0), abs=1e-12)
    assert line.start < change.stamp < line.start + 5 * 10**9
    assert 0 < change.std_dev < 1e-4


def test_between_products_the_next_empty_belt_is_taken():
    segmenter = Segmenter(CELL, SegmenterParameters(zero_random_walk=0.0))
    events = make_line((0.1,) * 6).events()
    feed(segmenter, events[:40])
    segmenter.zero_keeper.request()
    feed(segmenter, events[40:])

    assert segmenter.zero_keeper.answer.change


@pytest.mark.parametrize(
    ('calibrated', 'noise', 'why'),
    [(0.0, 0, 'beyond zero_range'), (5000.0, 500_000, 'not at rest')],
)
def test_what_cannot_be_zeroed_says_why(calibrated, noise, why):
    line = make_line((0.1,), after=20.0)
    # A reading that grows: halves of 0.25 s are apart by a quarter of what it does in a second.
    line.counts[:] += (noise * np.arange(len(line.counts)) / 960).astype(np.int32)
    segmenter = Segmenter(replace(CELL, zero_counts=calibrated), CAREFUL)
    segmenter.zero_keeper.request()

    feed(segmenter, line.events())

    answer = segmenter.zero_keeper.answer
    assert answer.change is None
    assert why in answer.text


def test_a_belt_that_is_never_empty_is_not_zeroed():
    line = make_line((0.1,) * 90, spacing=0.15)
    segmenter = Segmenter(CELL, CAREFUL)
    events = line.events()
    feed(segmenter, events[:60])
    segmenter.zero_keeper.request()

    feed(segmenter, events[60:])

    assert segmenter.zero_keeper.answer.text == 'the belt was not empty within 10 s: not zeroed'


def test_with_60_ms_of_empty_belt_a_drift_of_100_g_an_hour_is_followed():
    # What the walk states covers the lag: two standard deviations, once the filter is steady.
    line = make_line((0.1,) * 200, spacing=0.36, after=0.1)
    rate, drift = CELL.sample_rate, 0.1 / 3600 * CELL.counts_per_kg
    time = np.arange(len(line.counts)) / rate
    # As the ring-down of a platform of 38 Hz and a damping ratio of 0.06 after each product.
    ringing = np.zeros(len(time))
    for product in line.products:
        since = time - (product.t4 - line.start) / 1e9
        decay = np.exp(-14.3 * np.clip(since, 0, None)) * np.cos(2 * np.pi * 38 * since)
        ringing += np.where(since > 0, 4000 * decay, 0)
    line.counts[:] += np.round(ringing + drift * time).astype(np.int32)

    windows = feed(
        Segmenter(CELL, SegmenterParameters(zero_random_walk=1e-4)), line.events(size=96)
    )

    errors = np.array(
        [w.zero - 5000 - drift * (w.t1 - line.start) / 1e9 for w in windows if not w.reasons]
    )
    stated = np.array([w.zero_std_dev for w in windows if not w.reasons])
    assert len(errors) == 200
    # Carried on from calibration the error would be 2 g after 72 s.
    assert np.all(np.abs(errors) <= 2 * stated)
    assert np.max(np.abs(errors)) < 1000

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches of windows against counts and times worked by hand."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_line import make_window

from checkweigher_core.records import NANOSECONDS
from checkweigher_dsp.denoising.window_batch import batches_of, rise_time, time_since_entry

ROUNDING = 1e-12


@pytest.fixture(name='window')
def _window():
    """Window at 1 kHz: t1 at sample 200, t2 half a sample before sample 300, t3 at sample 400."""
    stamp = 5 * NANOSECONDS
    t1, t2, t3 = (stamp + time for time in (200_000_000, 299_500_000, 400_000_000))
    return make_window(
        np.full(100, 0.2), lead=300, sample_rate=1000.0, stamp=stamp, t1=t1, t2=t2, t3=t3,
        counts_per_kg=1e6,
    )  # fmt: skip


def test_times_count_from_t1(window):
    time = time_since_entry(window)
    assert rise_time(window) == 0.0995
    assert time[[200, 300, 399]] == pytest.approx([0.0, 0.1, 0.199], abs=ROUNDING)


@pytest.mark.parametrize('stamp', [0, 2**60])
def test_a_stamp_that_cannot_be_leaves_the_window_within_a_sample_after_t2(window, stamp):
    assert 0.0995 <= time_since_entry(replace(window, stamp=stamp))[300] <= 0.1005 + ROUNDING


def test_without_t1_the_load_is_there_at_once(window):
    (batch,) = batches_of([replace(window, t1=None)], 1024)
    assert rise_time(replace(window, t1=None)) == 0.0
    np.testing.assert_array_equal(batch.share[0, batch.begin :], 1.0)


def test_a_batch_goes_from_the_empty_belt_to_t3(window):
    (batch,) = batches_of([replace(window, empty_begin=90)], 1024)

    # 210 samples before t2 are known and are taken in steps of 16: 208.
    assert batch.force.shape == (1, 308)
    assert (batch.begin, batch.entry) == (208, 108)
    assert batch.share[0, 108] == 0.0
    assert batch.share[0, 158] == pytest.approx(50 / 99.5)
    np.testing.assert_array_equal(batch.force[0, :208], 0.0)
    np.testing.assert_allclose(batch.force[0, 208:], 0.2, rtol=ROUNDING)
    # 1000 Hz over 240 Hz.
    assert batch.block == 4


def test_no_more_is_taken_than_the_padding_has_room_for(window):
    (batch,) = batches_of([window], 256)
    # (256 - 100) // 2 = 78, in steps of 16.
    assert batch.begin == 64
    assert batch.entry == 0


def test_windows_of_unlike_shape_come_into_unlike_batches(window):
    shorter = replace(window, window_end=399)
    faster = replace(window, sample_rate=2000.0)
    later = replace(window, t1=window.t1 + 20_000_000)
    batches = batches_of([window, shorter, window, faster, later], 1024)
    assert [batch.positions for batch in batches] == [(0, 2), (1,), (3,), (4,)]

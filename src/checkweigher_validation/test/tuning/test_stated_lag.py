# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lag of training passes on simulated lines whose samples are late by a known time."""

from dataclasses import replace

from lines import simulated
import pytest

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_validation.accuracy.passes import KnownPass, known_passes
from checkweigher_validation.tuning.stated_lag import stated_lag, unchecked

PLATFORM = SegmenterParameters().rise_lag  # of the simulated one: 2 xi / omega


def passes_at(speed: float, late: float) -> list[KnownPass]:
    """Return passes whose samples are `late` s late."""
    line = simulated(speed=speed, count=8, profile='quiet', zero_counts=5e4)
    moved = [replace(each, stamp=each.stamp + round(NANOSECONDS * late)) for each in line.blocks]
    events = Recording.from_events(line.load_cell, [*moved, *line.edges, *line.references])
    return known_passes(line.load_cell, events, unchecked(SegmenterParameters()))


def test_the_lag_of_one_speed_is_a_delay():
    found = stated_lag(passes_at(1.0, 0.004), SegmenterParameters())
    assert found.rise_lag_known
    assert found.rise_lag == pytest.approx(PLATFORM + 0.004, abs=2e-4)
    assert found.rise_lag_distance == 0.0


def test_the_lags_of_several_speeds_are_a_delay_and_a_distance():
    delay, distance = 0.004, 0.003
    passes = [each for speed in (0.5, 1.0) for each in passes_at(speed, delay + distance / speed)]
    found = stated_lag(passes, SegmenterParameters())

    assert found.rise_lag == pytest.approx(PLATFORM + delay, abs=3e-4)
    assert found.rise_lag_distance == pytest.approx(distance, abs=3e-4)
    assert found.rise_lag_tolerance == pytest.approx(SegmenterParameters().rise_lag_tolerance)


def test_what_a_delay_and_a_distance_do_not_explain_widens_the_tolerance():
    lates = {0.5: 0.0, 0.75: 0.006, 1.0: 0.0}
    passes = [each for speed, late in lates.items() for each in passes_at(speed, late)]
    found = stated_lag(passes, SegmenterParameters())
    assert found.rise_lag_tolerance > SegmenterParameters().rise_lag_tolerance + 0.002


def test_without_a_check_nothing_is_stated():
    segmenter = unchecked(SegmenterParameters())
    assert stated_lag(passes_at(1.0, 0.004), segmenter) == segmenter
    assert stated_lag([], SegmenterParameters()) == SegmenterParameters()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of statistics of recent values, with expected numbers that are computed by hand."""

import math

import pytest

from checkweigher_core.health.findings import Concern, Level, RecentItems, RecentValues, conclude


def test_values_are_forgotten_after_their_time():
    recent = RecentValues(duration=10.0)
    for time, value in enumerate((4.0, 1.0, 3.0, math.nan, 8.0)):
        recent.add(float(time), value)
    assert (recent.median, recent.largest, recent.smallest, recent.total) == (3.5, 8.0, 1.0, 16.0)
    recent.forget(11.0)
    assert recent.values.tolist() == [3.0, 8.0]
    recent.forget(15.0)
    assert math.isnan(recent.median)
    assert math.isnan(recent.largest)
    assert math.isnan(recent.quantile(0.5))


def test_the_slope_is_that_of_most_values():
    recent = RecentValues(duration=1e9)
    for time in range(20):
        # A fifth of the values are outliers.
        recent.add(time, 5.0 - 0.25 * time + (100.0 if time % 5 == 2 else 0.0))
    assert recent.slope == pytest.approx(-0.25, abs=1e-12)


def test_the_slope_is_that_of_the_values_that_are_there():
    recent = RecentValues(duration=10.0)
    recent.add(0.0, 7.0)
    recent.add(8.0, 3.0)
    assert recent.slope == -0.5
    recent.add(9.0, 4.0)
    assert recent.slope == pytest.approx(-1 / 3)  # the median of -1/2, -1/3 and 1
    recent.forget(10.0)
    assert recent.slope == 1.0
    recent.forget(20.0)
    assert math.isnan(recent.slope)


def test_values_span_a_time_and_there_is_no_slope_of_one_moment():
    recent = RecentValues()
    assert recent.span == 0.0
    for value in (2.0, 3.0):
        recent.add(1.0, value)
        assert math.isnan(recent.slope)
    recent.add(2.5, 6.0)
    assert (recent.span, recent.values[0]) == (1.5, 2.0)


def test_items_are_counted_by_their_first_reason():
    items = RecentItems(count=4, duration=60.0)
    for reasons in (('A',), (), ('B', 'A'), ('B',), ('A', 'B')):
        items.add(0.0, reasons)
    assert (len(items), items.failed, items.failed_in_a_row) == (4, 3, 3)
    assert (items.main_reason(4), items.main_reason(1)) == ('B', 'A')
    items.add(50.0)
    assert items.failed_in_a_row == 0
    items.forget(70.0)
    assert (len(items), items.failed, items.main_reason(1)) == (1, 0, '')


def test_the_worst_concern_is_told_the_first_of_these():
    concerns = [
        Concern(Level(level), text, 'look') for level, text in ((1, 'a'), (2, 'b'), (2, 'c'))
    ]
    found = conclude('Any', 'well', concerns, {'x': 1.0})
    assert (found.level, found.message, found.values) == (Level.ERROR, 'b; look', {'x': 1.0})
    assert conclude('Any', 'well', []).message == 'well'

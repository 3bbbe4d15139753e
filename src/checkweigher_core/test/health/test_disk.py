# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the prediction when a disk will be full, from free bytes that fall at a known rate."""

import math
from pathlib import Path

import pytest

from checkweigher_core.health.disk import DiskWatch, free_bytes
from checkweigher_core.health.findings import Level

DAY = 86_400


def watched(*free: float, period: float = 600.0) -> list[Level]:
    """Return the levels of a monitor that reads these numbers of free bytes every `period` s."""
    values = iter(free)
    watch = DiskWatch(lambda: next(values))
    return [watch.finding(number * period).level for number in range(len(free))]


@pytest.mark.parametrize(('days', 'level'), [(29.0, Level.WARN), (32.0, Level.OK)])
def test_a_disk_that_is_full_in_less_than_30_days_is_told(days: float, level: Level):
    per_look = 50e9 / (days * DAY) * 600
    assert watched(*(50e9 - number * per_look for number in range(100)))[-1] == level


def test_an_hour_is_needed_for_a_trend():
    levels = watched(*(50e9 - number * 1e9 for number in range(7)))
    assert levels == [*6 * [Level.OK], Level.WARN]


def test_a_recording_that_is_removed_again_is_no_trend():
    free = [50e9 - (5e9 if 40 <= number < 60 else 0) for number in range(100)]
    assert set(watched(*free)) == {Level.OK}


def test_a_full_disk_is_an_error_at_once():
    assert watched(50e6) == [Level.ERROR]


def test_the_message_has_the_days():
    values = iter(20e9 - number * 20e9 / (10 * 144) for number in range(145))
    watch = DiskWatch(lambda: next(values))
    found = [watch.finding(number * 600.0) for number in range(145)][-1]
    assert found.text == 'full in about 9 days: 18.0 GB are free'
    assert found.values['days_left'] == pytest.approx(9)


def test_the_disk_is_looked_at_every_ten_minutes():
    assert watched(50e9, period=600.0)
    looks = []
    watch = DiskWatch(lambda: looks.append(None) or 50e9)  # type: ignore[func-returns-value]
    for number in range(1201):
        watch.finding(float(number))
    assert len(looks) == 3


def test_a_folder_that_is_gone_has_no_free_bytes(tmp_path: Path):
    assert free_bytes(tmp_path) > 0
    assert math.isnan(free_bytes(tmp_path / 'gone'))

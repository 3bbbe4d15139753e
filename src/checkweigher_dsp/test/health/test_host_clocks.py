# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.health.host_clocks import Exchange, HostClockWatch

US = 1000  # ns


def exchange(offset: int, there: int, back: int, wait: int = 10 * US) -> Exchange:
    """Make an exchange with a clock that is `offset` ns ahead."""
    heard = 10**9 + there + offset
    return Exchange(10**9, heard, heard + wait, 10**9 + there + wait + back)


def test_with_equal_ways_the_offset_is_exact():
    found = exchange(300 * US, 50 * US, 50 * US)
    assert found.offset == pytest.approx(300e-6, abs=1e-12)
    assert found.uncertainty == pytest.approx(50e-6, abs=1e-12)


@pytest.mark.parametrize(('there', 'back'), [(0, 100), (100, 0), (20, 80), (99, 1)])
def test_the_offset_is_within_half_of_the_round_trip(there: int, back: int):
    found = exchange(-70 * US, there * US, back * US)
    assert abs(found.offset + 70e-6) <= found.uncertainty + 1e-12


def test_the_shortest_round_trip_counts():
    watch = HostClockWatch()
    watch.add(0.0, exchange(10 * US, 900 * US, 0))
    watch.add(0.0, exchange(10 * US, 20 * US, 20 * US))
    watch.add(0.0, exchange(10 * US, 0, 900 * US))
    offset, uncertainty = watch.estimate(0.0)
    assert offset == pytest.approx(10e-6, abs=1e-12)
    assert uncertainty == pytest.approx(20e-6, abs=1e-12)


@pytest.mark.parametrize(
    ('offset', 'way', 'level'),
    [(0, 50, Level.OK), (140, 50, Level.OK), (160, 50, Level.WARN), (0, 210, Level.WARN),
     (260, 50, Level.ERROR), (-260, 50, Level.ERROR)],
)  # fmt: skip
def test_clocks_agree_only_where_it_is_sure(offset: int, way: int, level: Level):
    watch = HostClockWatch()
    watch.add(0.0, exchange(offset * US, way * US, way * US))
    assert watch.finding(0.0, 'server').level == level


def test_what_was_measured_gets_less_certain_and_is_forgotten():
    watch = HostClockWatch()
    watch.add(0.0, exchange(0, 50 * US, 50 * US))
    assert watch.finding(1.0, 'server').level == Level.OK  # 50 us + 100 us
    assert watch.finding(2.0, 'server').level == Level.WARN
    assert watch.finding(60.0, 'server').level == Level.ERROR
    assert math.isinf(watch.estimate(60.0)[1])


def test_a_clock_that_is_set_meanwhile_says_nothing():
    watch = HostClockWatch()
    watch.add(0.0, Exchange(1000, 2000, 1500, 3000))
    watch.add(0.0, Exchange(1000, 500, 600, 900))
    assert watch.finding(0.0, 'server').level == Level.ERROR

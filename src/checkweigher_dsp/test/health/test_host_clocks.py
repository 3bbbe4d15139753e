# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.health.host_clocks import ClockBoard, Exchange, HostClockWatch, KeptClock

US = 1000  # ns


def exchange(
    offset: int, there: int, back: int, wait: int = 10 * US, kept: KeptClock | None = None
) -> Exchange:
    """Make an exchange with a clock that is `offset` ns ahead."""
    heard = 10**9 + there + offset
    return Exchange(10**9, heard, heard + wait, 10**9 + there + wait + back, kept)


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


SERVER, OTHER = 0x0A000001, 0x0A000002


@pytest.mark.parametrize(
    ('offset', 'own', 'other', 'level'),
    [
        (0, KeptClock(SERVER, 90e-6), KeptClock(SERVER, 100e-6), Level.OK),
        (0, KeptClock(SERVER, 110e-6), KeptClock(SERVER, 100e-6), Level.WARN),
        (0, KeptClock(SERVER, 10e-6), KeptClock(OTHER, 10e-6), Level.WARN),
        (0, None, KeptClock(SERVER, 10e-6), Level.WARN),
        (0, KeptClock(SERVER, 10e-6), None, Level.WARN),
        # What was measured rules out what chrony says.
        (800, KeptClock(SERVER, 10e-6), KeptClock(SERVER, 10e-6), Level.ERROR),
    ],
)
def test_chrony_tells_what_a_slow_network_cannot(
    offset: int, own: KeptClock | None, other: KeptClock | None, level: Level
):
    watch = HostClockWatch()
    watch.add(0.0, exchange(offset * US, 500 * US, 500 * US, kept=other))
    assert watch.finding(0.0, 'server', own).level == level


def test_a_chrony_that_ended_says_nothing_more():
    watch, own = HostClockWatch(), KeptClock(SERVER, 10e-6)
    watch.add(0.0, exchange(0, 500 * US, 500 * US, kept=own))
    watch.add(0.1, exchange(0, 600 * US, 600 * US))
    assert watch.finding(0.1, 'server', own).level == Level.WARN


def board(*said: tuple[float, str, Level]) -> ClockBoard:
    found = ClockBoard()
    for each in said:
        found.add(*each)
    return found


HALL, BACK = 'supervisor_hall: Clock of server', 'supervisor_server: Clock of hall'


@pytest.mark.parametrize(
    ('said', 'agree'),
    [
        ([], False),
        ([(0.0, HALL, Level.OK)], True),
        ([(0.0, BACK, Level.OK)], True),
        ([(0.0, HALL, Level.OK), (0.0, BACK, Level.WARN)], True),
        ([(0.0, HALL, Level.OK), (0.0, BACK, Level.ERROR)], False),
        ([(0.0, HALL, Level.OK), (1.0, HALL, Level.WARN)], False),
        ([(-9.0, HALL, Level.OK)], False),  # its supervisor is silent
        ([(0.0, 'supervisor_hall: Clock of eyes', Level.OK)], False),
        ([(0.0, 'lane1/segmenter: Clock of server', Level.OK)], False),
    ],
)
def test_clocks_agree_where_a_supervisor_says_so_and_none_contradicts(
    said: list[tuple[float, str, Level]], agree: bool
):
    assert board(*said).agree(1.0, 'hall', 'server') == agree
    assert board(*said).agree(1.0, 'server', 'hall') == agree

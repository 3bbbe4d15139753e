# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""When an item is at the rejector or its station."""

import time

import pytest

from checkweigher_core.records import Decision, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_driver.line_io.rejector.arrivals import Arrivals, Times, at_station
from checkweigher_driver.line_io.rejector.belt_motion import BeltMotion

MS = 1_000_000


def judged(due, reason=None, **others):
    """Return arrivals, a verdict with `due` in ms from now, and now."""
    now, stamp = time.monotonic_ns(), time.time_ns()
    reasons = () if reason is None else (reason.value,)
    verdict = Verdict(
        1, stamp, Decision.FAULT, reasons, reject_at=stamp + due * MS, t1=stamp - 200 * MS, **others
    )
    return Arrivals(BeltMotion(10**9)), verdict, now


@pytest.mark.parametrize(
    ('due', 'reason', 'known'),
    [(500, None, True), (700_000, None, False), (500, Reason.BELT_STOPPED, False)],
)
def test_the_times_are_on_the_clock_that_never_steps(due, reason, known):
    arrivals, verdict, now = judged(due, reason)
    times = arrivals.times(verdict, now)
    assert (times is not None) == known
    if known:
        assert [round((each - now) / MS) for each in times] == [due, 0, -200]


def test_a_station_is_before_or_behind_the_rejector():
    times = Times(900, 100, 0)
    verdict = Verdict(1, 100, Decision.ACCEPT, reject_at=5900, station=2, station_at=6000)
    assert at_station(verdict, times) == Times(1000, 100, 0)
    assert at_station(Verdict(1, 100, Decision.ACCEPT, station=2), times) is None
    assert at_station(Verdict(1, 100, Decision.ACCEPT), times) == times

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""When an item is at the rejector or its station."""

from checkweigher_core.records import Decision, Verdict
from checkweigher_driver.line_io.rejector.arrivals import Times, at_station


def test_a_station_is_before_or_behind_the_rejector():
    times = Times(900, 100, 0)
    verdict = Verdict(1, 100, Decision.ACCEPT, reject_at=5900, station=2, station_at=6000)
    assert at_station(verdict, times) == Times(1000, 100, 0)
    assert at_station(Verdict(1, 100, Decision.ACCEPT, station=2), times) is None
    assert at_station(Verdict(1, 100, Decision.ACCEPT), times) == times

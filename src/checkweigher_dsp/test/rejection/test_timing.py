# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""When edges came, and when they should have come."""

import numpy as np
import pytest

from checkweigher_core.records import NANOSECONDS as S
from checkweigher_dsp.rejection.timing import ArrivalClock, StreamClock

OFFSET = 1_700_000_000 * S  # of the stamps against the clock of arrivals


def test_an_edge_that_was_held_up_came_when_its_way_was_free():
    clock = ArrivalClock()
    for second in range(5):
        assert clock.came(OFFSET + second * S, second * S + 1000) == second * S + 1000
    held = [clock.came(OFFSET + second * S, 8 * S) for second in (5, 6, 7)]
    # But for the 500e-6 that the clocks may have drifted apart in the 4 s without an edge.
    assert held == pytest.approx([5 * S, 6 * S, 7 * S], abs=0.002 * S + 1000)
    assert clock.came(OFFSET + 9 * S, 9 * S + 500) == 9 * S + 500


def test_the_first_edge_is_taken_for_one_that_nothing_held_up_until_a_faster_one_comes():
    clock = ArrivalClock()
    assert clock.came(OFFSET, 5 * S) == 5 * S
    assert clock.came(OFFSET + S, S) == S
    assert clock.came(OFFSET + 2 * S, 5 * S) == pytest.approx(2 * S, abs=0.003 * S)


@pytest.mark.parametrize('drift', [-200e-6, 200e-6])
def test_a_shift_of_drift_makes_no_edge_late(drift: float):
    clock = ArrivalClock()
    jitter = np.random.default_rng(1).uniform(0, 0.005 * S, 8 * 3600)
    for second, delay in enumerate(jitter):
        now = second * S + int(delay)
        assert now - 0.006 * S < clock.came(OFFSET + round(second * S * (1 + drift)), now) <= now


def test_a_new_stream_has_an_offset_of_its_own():
    clock = ArrivalClock()
    clock.came(OFFSET, 0)
    assert clock.came(OFFSET - 3600 * S, 10 * S) == 10 * S


def test_a_stamp_is_reached_by_time_only_where_the_clock_runs():
    running, standing = StreamClock(running=True), StreamClock(running=False)
    assert (running.at(5), running.reaches(1000, 5)) == (None, None)
    for clock in (running, standing):
        clock.saw(1000, 7)

    assert (running.at(10), standing.at(10)) == (1003, 1000)
    assert (running.reaches(1010, 9), running.reaches(990, 9)) == (17, 9)
    assert (standing.reaches(1010, 9), standing.reaches(990, 9)) == (None, 9)

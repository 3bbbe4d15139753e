# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is known of a belt with and without an input."""

import pytest

from checkweigher_driver.line_io.rejector.belt_motion import BeltMotion


@pytest.mark.parametrize('measured', [None, True])
def test_only_a_stop_that_no_input_measures_leaves_the_places_unknown(measured):
    motion = BeltMotion(watchdog_time=100)
    motion.measure(measured, 0)
    assert not motion.allow(False, 5)  # it has not run yet
    assert not motion.allow(True, 10)
    assert motion.allow(False, 20) == (measured is None)
    stopped = [motion.was_stopped_since(time) for time in (19, 20, None)]
    assert stopped == [measured is None, False, False]
    assert motion.released
    motion.clear()
    assert not motion.released


def test_the_time_of_the_belt_goes_on_when_its_input_does():
    motion = BeltMotion(watchdog_time=100)
    found = [motion.measure(runs, now) for runs, now in ((False, 10), (False, 20), (True, 30))]
    assert found == [None, None, 10]


def test_a_silence_counts_once_and_only_while_the_belt_might_run():
    motion = BeltMotion(watchdog_time=100)
    motion.heartbeat(0)
    assert not motion.is_silent(1000)
    motion.allow(True, 1000)
    motion.heartbeat(1000)
    assert [motion.is_silent(now) for now in (1100, 1101, 1102)] == [False, True, False]

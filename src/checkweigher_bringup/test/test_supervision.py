# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""When a process is started again, and when it is hung, without any process."""

from checkweigher_bringup.supervision import Action, Supervision


def test_a_process_that_died_is_started_again_after_the_delay():
    process = Supervision()
    assert process.due(0.0) is Action.START
    assert process.started(0.0) == 0.0
    process.heard(99.0)
    process.ended(100.0, -9)
    assert process.reason == 'killed by signal 9 (SIGKILL)'
    assert process.due(100.9) is Action.NOTHING
    assert process.due(101.0) is Action.START
    assert process.started(101.2) == 101.2 - 100.0


def test_one_that_dies_at_once_again_and_again_waits_longer_up_to_a_limit():
    process = Supervision()
    now, delays = 0.0, []
    for _ in range(6):
        process.started(now)
        process.ended(now + 0.5, 1)
        begin = now = now + 0.5
        while process.due(now) is not Action.START:
            now += 0.25
        delays.append(now - begin)
    assert delays == [1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    process.started(now)
    process.ended(now + 60.0, 1)
    assert process.due(now + 61.0) is Action.START


def test_what_cannot_start_is_given_up_but_not_what_has_worked():
    process = Supervision()
    process.started(0.0)
    process.ended(1.0, 2)
    assert process.due(1.0) is Action.GIVE_UP
    process = Supervision()
    process.started(0.0)
    process.heard(2.0)
    process.ended(3.0, 2)
    assert process.due(4.0) is Action.START


def test_a_silent_process_is_killed_once_and_said_to_have_hung():
    process = Supervision()
    process.started(0.0)
    assert process.due(29.0) is Action.NOTHING  # it may take its time to start
    process.heard(29.0)
    assert process.due(33.0) is Action.NOTHING
    assert process.due(34.5) is Action.KILL
    assert process.due(34.6) is Action.NOTHING
    process.ended(34.7, -9)
    assert process.reason == 'hung: no diagnostics for 5 s'
    assert process.due(35.7) is Action.START
    process.started(35.7)
    assert process.due(65.0) is Action.NOTHING
    assert process.due(66.0) is Action.KILL


def test_diagnostics_of_a_process_that_has_ended_do_not_count_for_the_next():
    process = Supervision()
    process.started(0.0)
    process.ended(1.0, -11)
    process.heard(1.5)
    process.started(2.0)
    assert process.due(20.0) is Action.NOTHING

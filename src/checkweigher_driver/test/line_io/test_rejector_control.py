# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decisions of the outputs at given times, without a thread and without a port."""

from dataclasses import replace
import time

import pytest

from checkweigher_core.records import Decision, Eye, EyeEdge, Item, Permission, StopRequest, Verdict
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_core.ros.ports import FRESH_TIME
from checkweigher_driver.line_io.belt_record import OnBelt
from checkweigher_driver.line_io.rejector.switching import Levels, Switches
from checkweigher_driver.line_io.rejector_control import OutputParameters, RejectorControl

MS = 1_000_000
FOREVER = 10**12
UNKNOWN = 'its arrival time at the rejector is unknown'
RUN, STOP, REJECT = Levels(False, False), Levels(False, True), Levels(True, False)


def control(**parameters):
    made = RejectorControl(OutputParameters(**parameters), permits=True)
    made.active = made.connected = True
    permit(made, time.monotonic_ns() + FOREVER)
    made.levels(time.monotonic_ns())  # lets the belt run
    return made


def permit(outputs, now, *, run=True):
    outputs.run_permission.take_permission(Permission(0, run), now)


def trouble(text):
    return StopRequest(StopReason.DRIVER_TROUBLE, 0, text=text)


def fault(due, now, **others):
    """Return a FAULT whose reject time is `due` ns of the monotonic clock, told at `now`."""
    stamp = time.time_ns() - time.monotonic_ns() + due
    return Verdict(7, stamp - 100 * MS, Decision.FAULT, reject_at=stamp, **others)


def test_a_reject_acts_at_its_time_for_the_length_of_a_pulse():
    outputs, now = control(pulse=0.1), time.monotonic_ns()
    outputs.verdict(fault(now + 500 * MS, now), now)
    at = {after: outputs.levels(now + after * MS) for after in (400, 505, 595, 605)}
    assert at == {400: RUN, 505: REJECT, 595: REJECT, 605: RUN}
    assert outputs.missed.text == ''


@pytest.mark.parametrize(
    ('ahead', 'others', 'text'),
    [
        (-50, {}, 'item 7: its verdict came 50 ms after its reject time'),
        (100, {'reasons': ('BeltStopped',)}, UNKNOWN),
        (700_000, {}, UNKNOWN),
    ],
)
def test_a_reject_without_a_time_to_come_acts_at_once_and_stops_the_line(ahead, others, text):
    outputs, now = control(), time.monotonic_ns()
    outputs.verdict(fault(now + ahead * MS, now, **others), now)
    assert outputs.levels(now) == Levels(True, True)
    assert text in outputs.missed.text
    assert outputs.figures['late rejects'] == (ahead < 0)


def test_a_verdict_that_does_not_come_ejects_and_stops():
    outputs, now = control(verdict_timeout=0.3), time.monotonic_ns()
    outputs.edge(EyeEdge(time.time_ns(), Eye.OUTFEED, True), now)
    assert outputs.levels(now + 299 * MS) == RUN
    assert outputs.levels(now + 301 * MS) == Levels(True, True)
    assert 'no verdict came within 0.3 s' in outputs.missed.text
    outputs.missed.clear()
    outputs.edge(EyeEdge(time.time_ns(), Eye.OUTFEED, True), now + 400 * MS)
    outputs.verdict(Verdict(1, None, Decision.ACCEPT), now + 500 * MS)
    assert outputs.levels(now + 900 * MS) == RUN


def test_a_reject_before_the_outputs_are_active_is_missed_only_if_nothing_is_ejected():
    for safe_state, text in (('eject', ''), ('retract', 'item 7: the rejector was not active')):
        outputs, now = control(safe_state=safe_state), time.monotonic_ns()
        outputs.make_safe()
        outputs.verdict(fault(now + 100 * MS, now), now)
        assert outputs.levels(now) == Levels(safe_state == 'eject', True)
        assert outputs.missed.text.startswith(text)
        assert bool(outputs.missed.text) == bool(text)


def test_a_missed_product_stops_the_line_until_a_request_that_shows_it_is_taken_back():
    outputs, now = control(), time.monotonic_ns()
    outputs.missed.add('item 7')
    assert outputs.levels(now) == STOP
    outputs.run_permission.take_request(None)
    assert outputs.levels(now) == STOP
    outputs.run_permission.take_request(trouble('item 7'))
    outputs.run_permission.take_request(StopRequest(StopReason.NOT_READY, 0))
    outputs.run_permission.take_request(None)
    assert outputs.levels(now) == STOP
    outputs.run_permission.take_request(trouble('item 7'))
    outputs.run_permission.take_request(None)
    assert outputs.levels(now) == RUN


def test_the_line_runs_while_a_permission_is_fresh():
    outputs, now = control(), time.monotonic_ns()
    assert RejectorControl(OutputParameters()).levels(now).stop
    fresh = round(1e9 * FRESH_TIME)
    permit(outputs, now)
    assert outputs.levels(now + fresh) == RUN
    assert outputs.levels(now + fresh + MS) == STOP
    permit(outputs, now + 500 * MS)
    assert outputs.levels(now + 500 * MS) == RUN
    permit(outputs, now + 510 * MS, run=False)
    assert outputs.levels(now + 510 * MS) == STOP


T1 = 300 * MS  # of an item, before its t3


def passing(outputs, due, now, decision, number=7):
    """Have an item of 100 ms enter and be judged; it is at the rejector at `due`."""
    to_stamp = time.time_ns() - time.monotonic_ns()
    t3 = due + to_stamp - 500 * MS
    outputs.edge(EyeEdge(t3 - T1, Eye.INFEED, True), now)
    outputs.edge(EyeEdge(t3 - T1 + 100 * MS, Eye.INFEED, False), now)
    outputs.verdict(Verdict(number, t3, decision, reject_at=due + to_stamp, t1=t3 - T1), now)


def permitted(outputs, begin, until):
    """Return the ms after `begin` at which something may pass."""
    return [ms for ms in range(0, until, 10) if outputs.levels(begin + ms * MS).permit]


def test_only_an_accepted_item_may_pass_and_only_while_it_is_there():
    outputs, now = control(permit_margin=0.02), time.monotonic_ns()
    passing(outputs, now + 305 * MS, now, Decision.ACCEPT, 7)
    passing(outputs, now + 605 * MS, now, Decision.UNDER, 8)
    passing(outputs, now + 905 * MS, now, Decision.ACCEPT, 9)
    assert permitted(outputs, now, 1200) == [*range(290, 430, 10), *range(890, 1030, 10)]
    assert (outputs.figures['permits'], outputs.figures['permits withheld']) == (2, 0)


@pytest.mark.parametrize('ahead', [-10, 700_000])
def test_an_accepted_item_whose_time_is_past_or_not_known_may_not_pass(ahead):
    outputs, now = control(), time.monotonic_ns()
    passing(outputs, now + ahead * MS, now, Decision.ACCEPT)
    assert permitted(outputs, now, 500) == []
    assert outputs.figures['permits withheld'] == 1
    assert outputs.missed.text == ''


def test_a_belt_that_is_stopped_leaves_a_rejected_item_in_doubt_and_permits_nothing():
    outputs, now = control(), time.monotonic_ns()
    passing(outputs, now + 300 * MS, now, Decision.ACCEPT, 7)
    passing(outputs, now + 600 * MS, now, Decision.OVER, 8)
    permit(outputs, now, run=False)
    outputs.levels(now + 100 * MS)
    permit(outputs, now + FOREVER)
    assert 'the belt was stopped before all items had passed the rejector' in outputs.missed.text
    assert 'item 8 OVER' in outputs.missed.text
    assert 'item 7' not in outputs.missed.text
    outputs.missed.clear()
    assert permitted(outputs, now + 110 * MS, 700) == []


def test_with_a_belt_input_a_stop_leaves_nothing_in_doubt():
    outputs, now = control(), time.monotonic_ns()
    outputs.belt(True, now)
    outputs.levels(now)
    passing(outputs, now + 300 * MS, now, Decision.OVER)
    permit(outputs, now, run=False)
    outputs.levels(now + 100 * MS)
    assert outputs.missed.text == ''


def test_a_verdict_on_what_was_on_its_way_during_a_stop_stops_the_line_again():
    outputs, now = control(), time.monotonic_ns()
    permit(outputs, now, run=False)
    outputs.levels(now)
    permit(outputs, now + FOREVER)
    outputs.levels(now)
    passing(outputs, now + 300 * MS, now, Decision.ACCEPT)
    assert permitted(outputs, now, 600) == []
    passing(outputs, now + 300 * MS, now, Decision.OVER)
    assert 'the belt was stopped on its way to the rejector' in outputs.missed.text


@pytest.mark.parametrize(('silent', 'in_doubt'), [(200, False), (300, True)])
def test_a_silence_in_which_the_machine_stops_by_itself_leaves_all_in_doubt(silent, in_doubt):
    outputs, now = control(watchdog_time=0.25), time.monotonic_ns()
    outputs.alive(now, now)
    passing(outputs, now + 50 * MS, now, Decision.OVER)  # which does not get there
    outputs.levels(now + silent * MS)
    outputs.alive(now + silent * MS, now + silent * MS)
    assert ('no heartbeat for 0.25 s' in outputs.missed.text) == in_doubt
    assert ('item 7 OVER' in outputs.missed.text) == in_doubt


def test_a_lost_connection_leaves_what_is_on_the_belt_in_doubt():
    outputs, now = control(), time.monotonic_ns()
    outputs.disconnect()
    outputs.connect(now)
    assert outputs.missed.text == ''
    passing(outputs, now + 900 * MS, now, Decision.ACCEPT)
    outputs.disconnect()
    outputs.connect(now)
    assert 'the connection to the machine was lost' in outputs.missed.text


def test_the_safe_state_leaves_what_is_on_the_belt_in_doubt_and_nothing_else():
    outputs, now = control(), time.monotonic_ns()
    assert outputs.on_belt().to_look_for() == (OnBelt(released=True).to_look_for())
    outputs.make_safe()
    assert outputs.on_belt() == OnBelt()
    outputs.active = True
    passing(outputs, now + 900 * MS, now, Decision.UNDER)
    outputs.make_safe()
    (text,) = outputs.on_belt().to_look_for()
    assert 'item 7 UNDER' in text
    outputs.active = True
    assert outputs.levels(now).stop


def test_a_permit_that_ends_late_stops_the_line():
    outputs, now = control(late_tolerance=0.01), time.monotonic_ns()
    before, due = Levels(False, False, True), Switches(permit=now)
    outputs.switched(before, RUN, due, now + 5 * MS, now + 9 * MS)
    assert outputs.missed.text == ''
    outputs.switched(before, RUN, due, now + 5 * MS, now + 11 * MS)
    assert 'the end of a permit was 11 ms late' in outputs.missed.text


def test_what_a_person_has_cleared_from_the_belt_does_not_stop_it_once_more():
    outputs, now = control(), time.monotonic_ns()
    stamp = time.time_ns() - time.monotonic_ns() + now
    outputs.missed.add('item 6')
    outputs.levels(now)
    outputs.missed.clear()
    outputs.levels(now)
    given_up = Verdict(7, None, Decision.FAULT, t1=stamp - 100 * MS)
    outputs.verdict(given_up, now)
    assert outputs.levels(now) == RUN
    outputs.verdict(replace(given_up, t1=stamp + 100 * MS), now)
    assert outputs.levels(now).stop


def silence(outputs, now):
    permit(outputs, now)
    outputs.levels(now + 1000 * MS)


def test_a_reject_node_that_was_started_again_takes_back_nothing_that_it_has_not_shown():
    outputs, now = control(), time.monotonic_ns()
    outputs.missed.add('item 6')
    outputs.run_permission.take_request(trouble('item 6'))
    silence(outputs, now)
    outputs.run_permission.take_request(None)
    assert outputs.levels(now) == STOP
    outputs.missed.clear()
    outputs.run_permission.take_request(
        StopRequest(StopReason.UNCONFIRMED_REJECT, 0, text='check it')
    )
    silence(outputs, now)
    outputs.run_permission.take_request(None)
    permit(outputs, now + FOREVER)
    assert outputs.levels(now) == STOP
    assert outputs.missed.text.startswith('UnconfirmedReject: ')
    assert outputs.missed.text.endswith(': check it')


def test_a_product_that_nobody_saw_leave_the_belt_is_ejected_when_it_is_at_the_rejector():
    outputs, now = control(late_tolerance=0.01), time.monotonic_ns()
    passing(outputs, now + 900 * MS, now, Decision.ACCEPT)  # 800 ms from entry to rejector
    entered = time.time_ns() - time.monotonic_ns() + now
    outputs.edge(EyeEdge(entered, Eye.INFEED, True), now)
    outputs.announce(Item(entered, 1, 9, t1=entered))
    assert outputs.levels(now + 799 * MS) == RUN
    assert outputs.levels(now + 815 * MS)[:2] == (True, True)
    assert 'item 9 without a verdict' in outputs.missed.text
    assert 'must be at the rejector by now' in outputs.missed.text


@pytest.mark.parametrize('reason', [Reason.DISTANCE_FAULT, Reason.EDGE_MISMATCH])
@pytest.mark.parametrize(('transit', 'in_doubt'), [(T1, False), (T1 + 500 * MS, True)])
def test_the_place_of_two_products_that_were_taken_for_one_is_not_known(
    transit: int, in_doubt: bool, reason: Reason
):
    outputs, now = control(), time.monotonic_ns()
    passing(outputs, now + 900 * MS, now, Decision.ACCEPT)
    stamp, reasons = time.time_ns() - time.monotonic_ns() + now, (reason.value,)
    way = 800 * MS * transit // T1  # at the speed by the eyes
    t3 = stamp - 100 * MS
    due = t3 - transit + way
    outputs.verdict(Verdict(8, t3, Decision.FAULT, reasons, reject_at=due, t1=t3 - transit), now)
    assert ('is unknown' in outputs.missed.text) == in_doubt

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decisions of the outputs at given times, without a thread and without a port."""

import time

import pytest

from checkweigher_driver.line_io.rejector_control import (
    Levels,
    OutputParameters,
    RejectorControl,
)
from checkweigher_dsp.reasons import StopReason
from checkweigher_dsp.records import Decision, Eye, EyeEdge, Verdict

MS = 1_000_000
RUN, STOP, REJECT = Levels(False, False), Levels(False, True), Levels(True, False)


def control(**parameters):
    made = RejectorControl(OutputParameters(**parameters))
    made.active = made.connected = True
    made.stop_requested = False
    return made


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
        (
            100,
            {'reasons': ('BeltStopped',)},
            'the time at which it is at the rejector is not known',
        ),
        (700_000, {}, 'the time at which it is at the rejector is not known'),
    ],
)
def test_a_reject_without_a_time_to_come_acts_at_once_and_stops_the_line(ahead, others, text):
    outputs, now = control(), time.monotonic_ns()
    outputs.verdict(fault(now + ahead * MS, now, **others), now)
    assert outputs.levels(now) == Levels(True, True)
    assert text in outputs.missed.text


def test_a_verdict_that_does_not_come_ejects_and_stops():
    outputs, now = control(verdict_timeout=0.3), time.monotonic_ns()
    outputs.edge(EyeEdge(time.time_ns(), Eye.OUTFEED, True), now)
    assert outputs.levels(now + 299 * MS) == RUN
    assert outputs.levels(now + 301 * MS) == Levels(True, True)
    assert 'no verdict came within 0.3 s' in outputs.missed.text


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
    outputs.take_request(False, '', '')
    assert outputs.levels(now) == STOP
    outputs.take_request(True, StopReason.DRIVER_TROUBLE, 'the driver has trouble: item 7')
    outputs.take_request(True, StopReason.NOT_READY, '')
    outputs.take_request(False, '', '')
    assert outputs.levels(now) == STOP
    outputs.take_request(True, StopReason.DRIVER_TROUBLE, 'the driver has trouble: item 7')
    outputs.take_request(False, '', '')
    assert outputs.levels(now) == RUN

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""When the line should stop: too many rejects, or a rejector that does not do what it is told."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_core.records import (
    Decision,
    Eye,
    EyeEdge,
    MassEstimate,
    ProductOnLine,
    Verdict,
    ZeroChange,
)
from checkweigher_core.records.reasons import StopReason
from checkweigher_dsp.rejection.limits import tolerance
from checkweigher_dsp.rejection.monitoring import RejectMonitor
from checkweigher_dsp.rejection.parameters import RejectParameters

SECOND = 1_000_000_000
WINDOW = RejectParameters(confirmation_time=0.1)
FAR = 1000 * SECOND


def _verdict(number, decision=Decision.UNDER):
    """Return a verdict on an item that is at the rejector `number` seconds after 0."""
    return Verdict(number, number * SECOND - 1, decision, reject_at=number * SECOND)


def _seen(seconds, blocked=True):
    return EyeEdge(round(seconds * SECOND), Eye.OUTFEED, blocked)


def _play(verdicts, edges, parameters=WINDOW):
    monitor = RejectMonitor(parameters)
    for verdict in verdicts:
        monitor.add_verdict(verdict)
    for edge in edges:
        monitor.add_edge(edge)
    return monitor, monitor.advance(FAR)


def _monitor(*played):
    return _play(*played)[0]


@pytest.mark.parametrize('at', [2.9, 3.0, 3.1])
def test_a_reject_that_is_seen_within_the_window_is_confirmed(at):
    monitor, strays = _play([_verdict(3)], [_seen(at), _seen(at + 0.05, blocked=False)])

    assert (monitor.request, strays) == (None, 0)


@pytest.mark.parametrize('edges', [[], [_seen(2.89)], [_seen(3.11)], [_seen(3.0, blocked=False)]])
@pytest.mark.parametrize('decision', [Decision.FAULT, Decision.UNDER, Decision.OVER])
def test_a_reject_that_is_not_seen_there_stops_the_line(decision, edges):
    monitor = _monitor([_verdict(3, decision)], edges)

    assert monitor.request.reason is StopReason.UNCONFIRMED_REJECT
    assert (monitor.request.item_id, monitor.request.stamp) == (3, 3 * SECOND)


def test_an_accepted_item_among_the_rejects_stops_the_line():
    monitor = _monitor([_verdict(3, Decision.ACCEPT)], [_seen(3.05)])

    assert monitor.request.reason is StopReason.CONFIRMED_ACCEPT


def test_an_edge_belongs_to_the_item_whose_reject_time_is_nearest():
    near = RejectParameters(confirmation_time=0.8)
    verdicts = [_verdict(3), _verdict(4, Decision.ACCEPT)]

    assert _monitor(verdicts, [_seen(3.4)], near).request is None
    assert _monitor(verdicts, [_seen(3.0), _seen(3.6)], near).request.item_id == 4


def test_what_passes_the_eye_near_no_item_is_counted():
    assert _play([], [_seen(5.0)])[1] == 1


def test_without_the_eye_nothing_is_expected_there():
    monitor, strays = _play([_verdict(3)], [_seen(7.0)], RejectParameters())

    assert (monitor.request, strays, monitor.due) == (None, 0, None)


@given(st.lists(st.sampled_from(Decision), max_size=12), st.integers(0, 4))
def test_as_many_rejects_in_a_row_as_allowed_and_no_more(decisions, limit):
    monitor = RejectMonitor(RejectParameters(max_rejects_in_a_row=limit))
    letters = ''
    for number, decision in enumerate(decisions, 1):
        monitor.add_verdict(_verdict(number, decision))
        letters += 'a' if decision is Decision.ACCEPT else 'r'

    position = letters.find('r' * limit) if limit else -1
    if position < 0:
        assert monitor.request is None
    else:
        assert monitor.request.reason is StopReason.TOO_MANY_REJECTS
        assert monitor.request.item_id == position + limit


def test_the_first_reason_stays_until_the_reset_and_counting_starts_again():
    monitor = RejectMonitor(RejectParameters(max_rejects_in_a_row=2))
    for number in range(1, 6):
        monitor.add_verdict(_verdict(number))
    assert monitor.request.item_id == 2

    monitor.reset(0)
    assert monitor.request is None
    monitor.add_verdict(_verdict(6))
    assert monitor.request is None
    monitor.add_verdict(_verdict(7))
    assert monitor.request.item_id == 7


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('trouble', StopReason.DRIVER_TROUBLE),
        ('strangers', StopReason.FOREIGN_PUBLISHER),
        ('zero_step', StopReason.ZERO_STEP),
    ],
)
def test_what_lasts_stops_the_line_until_it_is_over_and_the_request_is_reset(name, reason):
    monitor = RejectMonitor(RejectParameters())

    def check(text):
        setattr(monitor, name, text)
        monitor.check(0)

    check('')
    assert monitor.request is None
    check('the port is gone')
    assert monitor.request.reason is reason
    assert monitor.request.hint.endswith(': the port is gone')
    monitor.reset(0)
    assert monitor.request is not None
    check('')
    assert monitor.request.text == 'the port is gone'
    monitor.reset(0)
    assert monitor.request is None


def test_two_items_in_a_row_on_which_a_stage_failed_stop_the_line():
    monitor = RejectMonitor(RejectParameters())
    failed = ('StageFailed',)
    for number, reasons in enumerate([failed, (), failed, ('NoLoad',), failed]):
        monitor.add_verdict(replace(_verdict(number), reasons=reasons))
    assert monitor.request is None
    monitor.add_verdict(replace(_verdict(9), reasons=failed))
    assert (monitor.request.reason, monitor.request.item_id) == (StopReason.STAGE_FAILED, 9)


def _zeros(monitor, zeros, apart=1, tolerance=math.inf):
    for number, zero in enumerate(zeros):
        t1 = number * apart * SECOND
        monitor.add_zero(MassEstimate(number, t1, t1, t1, mass=0.15, zero=zero), tolerance)
    return monitor.request


@pytest.mark.parametrize(
    ('zeros', 'more', 'step'),
    [
        ((0.1, 0.1), {}, None),  # as it was at the start
        ((0.0, 0.015, 0.03), {}, None),
        ((0.0, 0.1, 0.1), {}, '+100.0 g before item 1'),
        ((0.1, 0.0), {}, '-100.0 g before item 1'),
        ((0.0, 0.015), {'tolerance': 0.0045}, '+15.0 g before item 1'),
        ((0.0, math.nan, 0.1), {}, '+100.0 g before item 2'),
        ((0.0, 0.015), {'tolerance': 0.0045, 'apart': 3600}, None),
        ((0.0, 0.1), {'apart': 600}, '+100.0 g before item 1'),
    ],
)
def test_a_step_of_the_zero_stops_the_line_until_it_is_zeroed(zeros, more, step):
    monitor = RejectMonitor(RejectParameters())
    request = _zeros(monitor, zeros, **more)
    assert (request and (request.reason, request.text)) == (step and (StopReason.ZERO_STEP, step))
    monitor.reset(0)
    assert (monitor.request is not None) == (step is not None)

    monitor.add_zero_change(ZeroChange(0, zeros[-1], zeros[0], 1e-4))
    monitor.reset(0)
    assert monitor.request is None
    assert _zeros(monitor, zeros[-1:]) is None


def test_an_item_that_was_not_weighed_shows_no_step():
    monitor = RejectMonitor(RejectParameters())
    monitor.add_zero(MassEstimate(1, 0, 0, 0, ('ZeroOutOfRange',)), 0.001)
    assert _zeros(monitor, (0.1,)) is None
    assert _zeros(RejectMonitor(RejectParameters(max_zero_step=0.0)), (0.0, 1.0)) is None


@pytest.mark.parametrize(
    ('limits', 'expected'),
    [
        ({}, math.inf),
        ({'lower_limit': 0.14, 'upper_limit': 0.15}, 0.005),
        ({'lower_limit': 0.141, 'nominal': 0.15}, 0.009),
        ({'lower_limit': 0.141, 'upper_limit': 0.145, 'nominal': 0.15}, 0.002),
        ({'lower_limit': 0.1}, math.inf),
    ],
)
def test_the_tolerance_of_a_product(limits, expected):
    assert tolerance(ProductOnLine(1, **limits)) == pytest.approx(expected)


def test_trouble_is_shown_when_the_reason_before_it_has_been_reset():
    monitor = RejectMonitor(RejectParameters(max_rejects_in_a_row=1))
    monitor.add_verdict(_verdict(1))
    monitor.trouble = 'item 1 was missed'
    monitor.check(0)
    assert monitor.request.reason is StopReason.TOO_MANY_REJECTS
    monitor.reset(0)
    assert monitor.request.reason is StopReason.DRIVER_TROUBLE
    monitor.trouble = 'item 1 was missed; item 2 was missed'
    monitor.check(0)
    assert monitor.request.text == monitor.trouble


def test_what_is_expected_is_due_when_its_window_is_over():
    monitor = RejectMonitor(WINDOW)
    monitor.add_verdict(_verdict(3))
    assert monitor.due == round(3.2 * SECOND) + 1
    monitor.add_edge(_seen(2.8))  # near no reject time
    assert monitor.due == round(2.9 * SECOND) + 1
    assert monitor.advance(monitor.due) == 1
    assert monitor.due == round(3.2 * SECOND) + 1
    monitor.advance(monitor.due - 1)
    assert monitor.request is None
    monitor.advance(monitor.due)
    assert monitor.request.reason is StopReason.UNCONFIRMED_REJECT
    assert monitor.due is None

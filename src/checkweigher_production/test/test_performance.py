# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The performance test: when it is due, what passes it, and when the line has to stop."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
import json
import math
import time

import pytest

from checkweigher_core.changes import plain
from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS, Decision, PerformanceState, Verdict
from checkweigher_production.performance import (
    LastTest,
    PerformancePlan,
    PerformanceTests,
    as_entry,
    from_entry,
)

HOUR, MINUTE = 3600 * NANOSECONDS, 60 * NANOSECONDS
NOW = round(datetime(2026, 5, 28, 10, 30, tzinfo=UTC).timestamp()) * NANOSECONDS
PLAN = PerformancePlan(mass=0.2, limit=0.0005, passes=3, every_hours=8.0, grace=600.0)
IN_TIME, DUE, OVERDUE = PerformanceState.IN_TIME, PerformanceState.DUE, PerformanceState.OVERDUE
# Time zones as POSIX writes them, for a computer without a list of zones.
BERLIN, NEW_YORK = 'CET-1CEST,M3.5.0,M10.5.0/3', 'EST5EDT,M3.2.0,M11.1.0'
RUNNING, FAILED = PerformanceState.RUNNING, PerformanceState.FAILED


def made(plan: PerformancePlan | None = PLAN, batch: str = 'b1') -> PerformanceTests:
    tests = PerformanceTests()
    tests.select('crisps', batch, plan, NOW)
    return tests


def made_pass(mass: float, *others: str) -> Verdict:
    return Verdict(1, NOW, Decision.FAULT, ('PerformanceTest', *others), mass=mass)


def passed_by(tests: PerformanceTests, now: int, *masses: float) -> LastTest:
    tests.begin('ann', now)
    *none, ended = [tests.take(made_pass(mass), now) for mass in masses]
    assert not any(none)
    assert ended is not None
    return ended


def test_what_was_never_tested_is_due_at_once_and_stops_the_line_after_the_grace():
    tests = made()
    assert (tests.state.state, tests.state.due) == (DUE, NOW)
    assert tests.state.stop_at == NOW + 10 * MINUTE
    assert not tests.advance(NOW + 10 * MINUTE - 1)
    assert tests.advance(NOW + 10 * MINUTE)
    assert (tests.state.state, tests.state.text) == (OVERDUE, 'none has passed yet')


def test_a_test_that_passed_counts_for_its_hours():
    tests = made()
    ended = passed_by(tests, NOW + MINUTE, 0.2004, 0.1996, 0.2)

    assert ended.passed
    assert ended.errors == pytest.approx((4e-4, -4e-4, 0.0))
    assert (tests.state.state, tests.state.who, tests.wanted) == (IN_TIME, 'ann', False)
    assert tests.state.due == NOW + MINUTE + 8 * HOUR
    tests.advance(NOW + MINUTE + 8 * HOUR)
    assert tests.state.state is DUE


@pytest.mark.parametrize('masses', [(0.2, 0.2006, 0.2), (0.2, math.nan, 0.2), (0.1994, 0.2, 0.2)])
def test_one_bad_pass_fails_the_test_until_one_passes(masses: tuple[float, ...]):
    tests = made()
    assert not passed_by(tests, NOW, *masses).passed
    assert tests.state.state is FAILED
    assert tests.state.text.startswith('1 of 3 passes of ann beyond 0.5 g')
    tests.advance(NOW + HOUR)
    assert tests.state.state is FAILED

    passed_by(tests, NOW + HOUR, 0.2, 0.2, 0.2)
    assert tests.state.state is IN_TIME


def test_a_pass_with_another_fault_has_no_mass():
    tests = made(replace(PLAN, passes=1))
    tests.begin('ann', NOW)
    ended = tests.take(made_pass(0.2, 'BeltSpeed'), NOW)
    assert not ended.passed


def test_items_of_before_the_test_are_no_passes():
    tests = made()
    tests.begin('ann', NOW)
    assert tests.take(Verdict(1, NOW, Decision.ACCEPT, mass=0.2), NOW) is None
    assert tests.state.errors == ()


def test_a_test_that_is_broken_off_leaves_what_was_due():
    tests = made()
    tests.begin('ann', NOW)
    assert (tests.state.state, tests.wanted) == (RUNNING, True)
    tests.advance(NOW + HOUR)  # while it is made nothing is overdue
    assert tests.state.state is RUNNING
    tests.cancel(NOW + HOUR)
    assert (tests.state.state, tests.wanted) == (OVERDUE, False)


def test_two_cannot_make_it_at_once_and_without_a_plan_there_is_none():
    tests = made()
    tests.begin('ann', NOW)
    with pytest.raises(ValueError, match='ann makes a performance test already'):
        tests.plan_to_begin()
    with pytest.raises(ValueError, match='asks for no performance test'):
        made(None).plan_to_begin()


@pytest.fixture
def zone(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Set the local time zone of the computer."""
    monkeypatch.setenv('TZ', request.param)
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(
    ('zone', 'last', 'due'),
    [
        ('UTC', '2026-05-28T10:30', '2026-05-28T14:00'),
        ('UTC', '2026-05-28T14:00', '2026-05-28T22:00'),
        ('UTC', '2026-05-28T23:00', '2026-05-29T06:00'),
        (BERLIN, '2026-05-28T12:30', '2026-05-28T20:00'),
        # The clock goes on to summer time at 01:00 UTC, and back in October.
        (BERLIN, '2026-03-28T21:30', '2026-03-29T04:00'),
        (BERLIN, '2026-10-24T20:30', '2026-10-25T05:00'),
        (NEW_YORK, '2026-11-01T03:30', '2026-11-01T11:00'),
    ],
    indirect=['zone'],
)
@pytest.mark.usefixtures('zone')
def test_each_shift_asks_for_its_own_by_local_time(last: str, due: str):
    plan = PerformancePlan(mass=0.2, limit=5e-4, shifts='06:00 14:00 22:00')
    last_ns, due_ns = (
        round(datetime.fromisoformat(f'{each}Z').timestamp()) * NANOSECONDS for each in (last, due)
    )
    assert plan.due(last_ns, 0, in_batch=True) == due_ns


def test_each_batch_asks_for_its_own_and_the_first_rule_counts():
    tests = made(replace(PLAN, every_batch=True))
    passed_by(tests, NOW, 0.2, 0.2, 0.2)
    assert tests.state.state is IN_TIME
    tests.select('crisps', 'b2', replace(PLAN, every_batch=True), NOW + HOUR)
    assert (tests.state.state, tests.state.due) == (DUE, NOW + HOUR)
    assert tests.state.text == 'none has passed in this batch'


def test_another_product_does_not_have_the_test_of_this_one():
    tests = made()
    passed_by(tests, NOW, 0.2, 0.2, 0.2)
    tests.select('nuts', 'b1', PLAN, NOW + MINUTE)
    assert tests.state.state is DUE
    tests.select('crisps', 'b1', PLAN, NOW + 2 * MINUTE)
    assert tests.state.state is IN_TIME


def test_after_a_restart_the_entry_of_the_log_counts():
    tests = made()
    ended = passed_by(tests, NOW, 0.2, 0.2001, 0.2)
    entry = json.loads(json.dumps(plain(as_entry(PLAN, ended, 'shift'))))

    after = PerformanceTests()
    after.remember('crisps', from_entry(entry))
    after.select('crisps', 'b1', PLAN, NOW + HOUR)
    assert (after.state.state, after.state.due) == (IN_TIME, NOW + 8 * HOUR)
    assert entry['who'] == 'ann'


@pytest.mark.parametrize(
    ('values', 'text'),
    [
        ({}, 'test.mass: must be given'),
        ({'mass': 0.2}, 'test.limit: must be given'),
        ({'mass': 0.2, 'limit': 1e-3}, 'needs every_hours, shifts or every_batch'),
        ({'mass': 0.2, 'limit': 1e-3, 'shifts': '6:00'}, 'are not times of day'),
        ({'mass': 0.2, 'limit': 1e-3, 'every_hours': 1, 'passes': 0}, 'test.passes'),
    ],
)
def test_a_plan_that_cannot_be_is_refused(values: dict[str, object], text: str):
    with pytest.raises(ParameterError, match=text):
        PerformancePlan.from_mapping(values)

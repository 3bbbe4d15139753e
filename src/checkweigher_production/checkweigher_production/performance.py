# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The performance test of a recipe: passes of a test product of known mass, at due times.

A recipe asks for it every so many hours, at the beginning of each shift, in each batch, or by
several of these. From the due time on a reminder shows; after the grace the line is asked to
stop. A test that passed counts until the next due time, one that failed stops the line until one
passes.
"""

from dataclasses import dataclass, replace
from datetime import datetime, timedelta, tzinfo
import math
import re
from typing import Any, ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    PerformanceState,
    PerformanceTest,
    Verdict,
)
from checkweigher_core.records.reasons import Reason

_HOUR = 3600 * NANOSECONDS
_TIME_OF_DAY = re.compile(r'([01]\d|2[0-3]):([0-5]\d)')
_MAX_SHIFTS = 24


@dataclass(frozen=True)
class PerformancePlan(Parameters):
    """When a recipe asks for a performance test, and what passes it."""

    node: ClassVar[str] = 'test'

    mass: float = parameter(
        0.0, 'mass of the test product with its packaging', unit='kg', minimum=0, maximum=1e4
    )
    limit: float = parameter(
        0.0, 'largest error of a pass to either side', unit='kg', minimum=0, maximum=1e3
    )
    passes: int = parameter(3, 'passes of the test product', minimum=1, maximum=100)
    every_hours: float = parameter(
        0.0, 'hours after which it is due again; 0 for no such rule', minimum=0, maximum=8760
    )
    shifts: str = parameter(
        '', 'times of day, of the computer, at which shifts begin, such as "06:00 14:00 22:00"'
    )
    every_batch: bool = parameter(False, 'whether it is due in each batch')
    grace: float = parameter(
        900.0, 'time from its due time to the stop request', unit='s', minimum=0, maximum=86400
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('mass', 'limit'):
            if not getattr(self, name):
                raise ParameterError(f'test.{name}: must be given, in kg')
        times = self.shifts.split()
        if len(times) > _MAX_SHIFTS or not all(map(_TIME_OF_DAY.fullmatch, times)):
            raise ParameterError(
                f'test.shifts: {self.shifts!r} are not times of day such as "06:00 14:00 22:00"'
            )
        if not (times or self.every_hours or self.every_batch):
            raise ParameterError('test: needs every_hours, shifts or every_batch')

    def due(self, last: int | None, began: int, *, in_batch: bool, zone: tzinfo) -> int | None:
        """Return when the next test is due, ns; None if the next batch asks for it first.

        `last` is when one has passed, None for never, `began` when the batch or the product began;
        `in_batch` tells whether one has passed in this batch. Shifts begin in the time `zone`.
        """
        if last is None:
            return began
        times = [began] if self.every_batch and not in_batch else []
        if self.every_hours:
            times.append(last + round(self.every_hours * _HOUR))
        if self.shifts:
            times.append(self._next_shift(last, zone))
        return min(times, default=None)

    def _next_shift(self, after: int, zone: tzinfo) -> int:
        moment = datetime.fromtimestamp(after / NANOSECONDS, zone)
        starts = []
        for text in self.shifts.split():
            hour, minute = map(int, text.split(':'))
            start = moment.replace(hour=hour, minute=minute, second=0, microsecond=0)
            starts.append(start if start > moment else start + timedelta(days=1))
        return round(min(starts).timestamp()) * NANOSECONDS


@dataclass(frozen=True)
class LastTest:
    """The last test that has ended: when, ns, in which batch, who made it, and how it ended."""

    time: int
    batch: str
    who: str
    passed: bool
    errors: tuple[float, ...] = ()


class PerformanceTests:
    """The test of the product on the line.

    All times are ns of the system clock; shifts begin in the time `zone`. While a test is `wanted`
    the line has to reject all items.
    """

    def __init__(self, zone: tzinfo) -> None:
        self._zone = zone
        self._plan: PerformancePlan | None = None
        # The last test and the last one that passed, by product.
        self._known: dict[str, tuple[LastTest, LastTest | None]] = {}
        self._began = 0
        self.state = PerformanceTest(0, PerformanceState.NOT_ASKED)

    @property
    def wanted(self) -> bool:
        """Whether a test goes on: each item is a test product, and is to be rejected."""
        return self.state.state is PerformanceState.RUNNING

    @property
    def plan(self) -> PerformancePlan | None:
        """What the recipe asks for, None for nothing."""
        return self._plan

    def remember(self, product: str, last: LastTest) -> None:
        """Take the last test of a product from before this start, if none is known."""
        self._known.setdefault(product, (last, last if last.passed else None))

    def select(self, product: str, batch: str, plan: PerformancePlan | None, now: int) -> None:
        """Take another product, batch or plan; a test that is under way is broken off."""
        if (product, batch, plan) != (self.state.product, self.state.batch, self._plan):
            self._began = now
        self._plan = plan
        self.state = PerformanceTest(now, PerformanceState.NOT_ASKED, product, batch)
        self.advance(now)

    def plan_to_begin(self) -> PerformancePlan:
        """Return what the recipe asks for; `ValueError` if that is nothing, or a test goes on."""
        if self._plan is None:
            raise ValueError('the recipe of the product asks for no performance test')
        if self.wanted:
            raise ValueError(f'{self.state.who} makes a performance test already')
        return self._plan

    def begin(self, who: str, now: int) -> None:
        """Begin a test; `ValueError` as `plan_to_begin`."""
        self.plan_to_begin()
        self.state = replace(
            self.state, stamp=now, state=PerformanceState.RUNNING, who=who, errors=(), text=''
        )

    def cancel(self, now: int) -> None:
        """Break off the test that is under way; what was due before is due still."""
        if self.wanted:
            self.state = replace(self.state, state=PerformanceState.NOT_ASKED, errors=())
            self.advance(now)

    def take(self, verdict: Verdict, now: int) -> LastTest | None:
        """Take a verdict; return the test if it ends with this pass."""
        plan = self._plan
        if plan is None or not self.wanted or Reason.PERFORMANCE_TEST not in verdict.reasons:
            return None
        known = set(verdict.reasons) == {Reason.PERFORMANCE_TEST.value}
        error = verdict.mass - plan.mass if known else math.nan
        errors = (*self.state.errors, error)
        self.state = replace(self.state, stamp=now, errors=errors)
        if len(errors) < plan.passes:
            return None
        ended = LastTest(now, self.state.batch, self.state.who, passes(plan, errors), errors)
        _, passed = self._known.get(self.state.product, (None, None))
        self._known[self.state.product] = ended, ended if ended.passed else passed
        self.state = replace(self.state, state=PerformanceState.NOT_ASKED)
        self.advance(now)
        return ended

    def advance(self, now: int) -> bool:
        """Advance to `now`; return whether the state has changed."""
        before = self.state
        if not self.wanted:
            self.state = self._judge(now)
        return before.state != self.state.state

    def _judge(self, now: int) -> PerformanceTest:
        plan, (last, passed) = self._plan, self._known.get(self.state.product, (None, None))
        if plan is None:
            return PerformanceTest(
                self.state.stamp, PerformanceState.NOT_ASKED, self.state.product, self.state.batch
            )
        in_batch = passed is not None and passed.batch == self.state.batch
        due = plan.due(
            passed.time if passed else None, self._began, in_batch=in_batch, zone=self._zone
        )
        stop_at = None if due is None else due + round(plan.grace * NANOSECONDS)
        if last is not None and not last.passed:
            state, text = PerformanceState.FAILED, _why_failed(plan, last)
        elif due is None or now < due:
            state, text = PerformanceState.IN_TIME, ''
        else:
            over = stop_at is not None and now >= stop_at
            state = PerformanceState.OVERDUE if over else PerformanceState.DUE
            text = 'none has passed yet' if passed is None else 'the last one is too long ago'
            if passed is not None and plan.every_batch and not in_batch:
                text = 'none has passed in this batch'
        return PerformanceTest(
            now if state != self.state.state else self.state.stamp, state,
            self.state.product, self.state.batch, text, last.who if last else '', due, stop_at,
            passed.time if passed else None, plan.mass, plan.limit, plan.passes,
            last.errors if last else (),
        )  # fmt: skip


def passes(plan: PerformancePlan, errors: tuple[float, ...]) -> bool:
    """Tell whether errors, kg, pass: each within the limit, none unknown."""
    return len(errors) >= plan.passes and all(abs(each) <= plan.limit for each in errors)


def _why_failed(plan: PerformancePlan, last: LastTest) -> str:
    bad = sum(not abs(each) <= plan.limit for each in last.errors)
    return (
        f'{bad} of {len(last.errors)} passes of {last.who} beyond {GRAMS * plan.limit:g} g '
        'or without a mass'
    )


def as_entry(plan: PerformancePlan, ended: LastTest, reason: str) -> dict[str, Any]:
    """Return what the audit log has of a test that has ended."""
    return {
        'passed': ended.passed,
        'time': ended.time,
        'batch': ended.batch,
        'who': ended.who,
        'reason': reason,
        'mass': plan.mass,
        'limit': plan.limit,
        'errors': ended.errors,
    }


def from_entry(values: dict[str, Any]) -> LastTest:
    """Return the test of an entry of the audit log."""
    return LastTest(
        int(values['time']), str(values['batch']), str(values['who']), bool(values['passed']),
        tuple(float(each) for each in values['errors']),
    )  # fmt: skip

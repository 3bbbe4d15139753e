# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Performance test: passes of a test product of known mass, at times that the recipe prescribes.

A test is due after a number of hours, at the start of each shift, in each batch, or at the first of
these times. A reminder is shown from the due time on. If no test has passed at the end of a grace
period, the line is stopped. A failed test stops the line until a test passes.
"""

from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime, time, timedelta
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
    local_time,
)
from checkweigher_core.records.reasons import Reason

_HOUR = 3600 * NANOSECONDS
_TIME_OF_DAY = re.compile(r'([01]\d|2[0-3]):([0-5]\d)')
_MAX_SHIFTS = 24


@dataclass(frozen=True)
class PerformancePlan(Parameters):
    """Due times and limits of the performance test of a recipe.

    Raises `ParameterError` if the mass or the limit is missing, if a shift is not a time of day, or
    if there is no rule for the due times.
    """

    node: ClassVar[str] = 'test'

    mass: float = parameter(
        0.0, 'mass of the test product with its packaging', unit='kg', minimum=0, maximum=1e4
    )
    limit: float = parameter(
        0.0, 'largest magnitude of the error of a pass', unit='kg', minimum=0, maximum=1e3
    )
    passes: int = parameter(
        3, 'number of passes of the test product in a test', minimum=1, maximum=100
    )
    every_hours: float = parameter(
        0.0,
        'hours from a passed test to the time at which the next one is due; 0 for no such rule',
        minimum=0,
        maximum=8760,
    )
    shifts: str = parameter(
        '',
        'local times of the computer at which shifts begin, such as "06:00 14:00 22:00"; a test is '
        'due at each of them',
    )
    every_batch: bool = parameter(False, 'whether a test is due in each batch')
    grace: float = parameter(
        900.0,
        'time from the due time of a test to the stop request',
        unit='s',
        minimum=0,
        maximum=86400,
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

    def due(self, last: int | None, began: int, *, in_batch: bool) -> int | None:
        """Return the time in ns at which the next test is due.

        If no test of the product has passed yet, a test is due at `began`. Returns None if no test
        is due before the next batch. Shifts begin at local times of the computer, which take
        account of summer time.

        Parameters
        ----------
        last : int or None
            Time in ns of the last test of the product that passed, or None if none has passed.
        began : int
            Time in ns at which the product or the batch was selected.
        in_batch : bool
            Whether a test has passed in this batch.
        """
        if last is None:
            return began
        times = (
            began if self.every_batch and not in_batch else None,
            last + round(self.every_hours * _HOUR) if self.every_hours else None,
            self._next_shift(last) if self.shifts else None,
        )
        return min((each for each in times if each is not None), default=None)

    def _next_shift(self, after: int) -> int:
        moment = local_time(after)
        starts = (
            # `astimezone` uses the offset from UTC that is valid at the start of this shift.
            datetime.combine(moment.date() + timedelta(days), time.fromisoformat(each)).astimezone()
            for days in (0, 1)
            for each in self.shifts.split()
        )
        return round(min(each for each in starts if each > moment).timestamp()) * NANOSECONDS


@dataclass(frozen=True)
class LastTest:
    """Last completed test of a product."""

    time: int  # time in ns of the system clock at which the test was completed
    batch: str  # name of the batch
    who: str  # name of the person who made the test
    passed: bool  # whether the error of each pass was within the limit
    errors: tuple[float, ...] = ()  # error of each pass in kg, NaN for a pass without a valid mass


_NEVER = LastTest(0, '', '', passed=True)  # value before the first test, which is not a failure


class PerformanceTests:
    """State of the performance test of the selected product.

    `plan` contains the rules of the recipe, or is None if the recipe requires no test. Times
    are in ns of the system clock.
    """

    def __init__(self) -> None:
        # The last test and the last test that passed, by product.
        self._known: dict[str, tuple[LastTest, LastTest | None]] = {}
        self._began = 0
        self.plan: PerformancePlan | None = None
        self.state = PerformanceTest(0, PerformanceState.NOT_ASKED)

    @property
    def wanted(self) -> bool:
        """Whether a test is running, so that all items are test products and must be rejected."""
        return self.state.state is PerformanceState.RUNNING

    def remember(self, product: str, last: LastTest) -> None:
        """Set the last test of a product from the audit log, unless a test is known already.

        If `last` has failed, no test of the product counts as passed.
        """
        self._known.setdefault(product, (last, last if last.passed else None))

    def select(self, product: str, batch: str, plan: PerformancePlan | None, now: int) -> None:
        """Cancel a running test, and continue with a product, a batch and a plan.

        If the product, the batch or the plan has changed, the first test of the product or batch is
        due from the time `now` on.
        """
        if (product, batch, plan) != (self.state.product, self.state.batch, self.plan):
            self._began = now
        self.plan = plan
        self.state = PerformanceTest(now, PerformanceState.NOT_ASKED, product, batch)
        self.advance(now)

    def plan_to_begin(self) -> PerformancePlan:
        """Return the plan of the test to begin. Raises `ValueError` if no test may begin now."""
        if self.plan is None:
            raise ValueError('the recipe of the product asks for no performance test')
        if self.wanted:
            raise ValueError(f'{self.state.who} makes a performance test already')
        return self.plan

    def begin(self, who: str, now: int) -> None:
        """Begin a test by the person `who`. The caller must have called `plan_to_begin`."""
        self.state = replace(
            self.state, stamp=now, state=PerformanceState.RUNNING, who=who, errors=(), text=''
        )

    def cancel(self, now: int) -> None:
        """Cancel the present test. The due time does not change."""
        self.state = replace(self.state, state=PerformanceState.NOT_ASKED, errors=())
        self.advance(now)

    def take(self, verdict: Verdict, now: int) -> LastTest | None:
        """Add a pass of the test product. Return the test if the pass completes it, otherwise None.

        Without a running test, and for a verdict without the reason PerformanceTest, nothing is
        added. The error of a pass is NaN if its verdict has another reason as well.
        """
        plan, test = self.plan, self.state
        if plan is None or not self.wanted or Reason.PERFORMANCE_TEST not in verdict.reasons:
            return None
        known = set(verdict.reasons) == {Reason.PERFORMANCE_TEST.value}
        error = verdict.mass - plan.mass if known else math.nan
        self.state = replace(test, stamp=now, errors=(*test.errors, error))
        errors = self.state.errors
        if len(errors) < plan.passes:
            return None
        ended = LastTest(now, test.batch, test.who, passes(plan, errors), errors)
        _, passed = self._known.get(test.product, (None, None))
        self._known[test.product] = ended, ended if ended.passed else passed
        self.state = replace(self.state, state=PerformanceState.NOT_ASKED)
        self.advance(now)
        return ended

    def advance(self, now: int) -> bool:
        """Update the state to the time `now` in ns; return whether the state has changed.

        The state does not change while a test is running, or without a plan.
        """
        before = self.state
        if self.plan is not None and not self.wanted:
            self.state = self._judge(self.plan, now)
        return before.state != self.state.state

    def _judge(self, plan: PerformancePlan, now: int) -> PerformanceTest:
        product, batch = self.state.product, self.state.batch
        last, passed = self._known.get(product, (_NEVER, None))
        passed_at = passed.time if passed else None
        in_batch = passed is not None and passed.batch == batch
        due = plan.due(passed_at, self._began, in_batch=in_batch)
        stop_at = None if due is None else due + round(plan.grace * NANOSECONDS)
        state, text = PerformanceState.IN_TIME, ''
        if not last.passed:
            state, text = PerformanceState.FAILED, _why_failed(plan, last)
        elif due is not None and now >= due:
            overdue = stop_at is not None and now >= stop_at
            state = PerformanceState.OVERDUE if overdue else PerformanceState.DUE
            text = _why_due(plan, passed, in_batch=in_batch)
        return PerformanceTest(
            stamp=self.state.stamp if state is self.state.state else now,
            state=state,
            product=product,
            batch=batch,
            mass=plan.mass,
            limit=plan.limit,
            passes=plan.passes,
            last=passed_at,
            due=due,
            stop_at=stop_at,
            who=last.who,
            errors=last.errors,
            text=text,
        )


def passes(plan: PerformancePlan, errors: tuple[float, ...]) -> bool:
    """Return whether all passes were made, and the magnitude of each error is within the limit.

    An error of NaN, as for a pass without a mass, is not within the limit.
    """
    return len(errors) >= plan.passes and all(abs(each) <= plan.limit for each in errors)


def _why_due(plan: PerformancePlan, passed: LastTest | None, *, in_batch: bool) -> str:
    if passed is None:
        return 'none has passed yet'
    if plan.every_batch and not in_batch:
        return 'none has passed in this batch'
    return 'the last one is too long ago'


def _why_failed(plan: PerformancePlan, last: LastTest) -> str:
    bad = sum(not abs(each) <= plan.limit for each in last.errors)
    return (
        f'{bad} of {len(last.errors)} passes of {last.who} beyond {GRAMS * plan.limit:g} g '
        'or without a mass'
    )


def as_entry(plan: PerformancePlan, ended: LastTest, reason: str) -> dict[str, Any]:
    """Return the content of the audit log entry of a completed test.

    `reason` is the reason that the person gave for the test.
    """
    return asdict(ended) | {'reason': reason, 'mass': plan.mass, 'limit': plan.limit}


def from_entry(values: dict[str, Any]) -> LastTest:
    """Return the test that the content of an audit log entry describes.

    Raises KeyError if a value of the test is missing.
    """
    own = {each.name: values[each.name] for each in fields(LastTest)}
    return LastTest(**own | {'errors': tuple(map(float, values['errors']))})

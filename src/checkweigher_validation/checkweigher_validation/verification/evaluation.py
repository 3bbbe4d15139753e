# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a procedure: each attempt at a step against the limits of the class.

What is judged, and from where that comes:

- Mean error and standard deviation of passes (each error in category Y): the limits of
  `checkweigher_validation.accuracy.classes`, whose sources stand there.
- Loads at rest: the same source; their limit is that of category X in both categories.
- Zero within 0.25 e after zeroing and within 0.5 e later, loads on other lanes within the error of
  the class, no mass outside the range of dynamic setting: OIML R 51-1:2006 as quoted
  from memory; its text was not at hand.
- A pass without a mass fails the step it belongs to: a rule of this program, so that a machine
  does not keep its limits by refusing to weigh.

The uncertainty of an error is expanded with k = 2: of the mean by the scatter, and of the reference
mass by its certificate. It is stated and not taken off the limits.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
import math
from statistics import median

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.classes import AccuracyClass, judge
from checkweigher_validation.accuracy.errors import ConditionResult
from checkweigher_validation.verification.plan import MINUTE, Mass
from checkweigher_validation.verification.procedure import AtRest, Attempt, Procedure
from checkweigher_validation.verification.steps import StepKind, steps_of

ZERO_ACCURACY, ZERO_STABILITY = 0.25, 0.5  # e
COVERAGE = 2.0  # k of the expanded uncertainty
WARM_UP_MINUTES = (0.0, 5.0, 15.0, 30.0)
LEVEL = 0.95  # of the intervals whose coverage is stated

_CLOSE = 1.25  # a load up to so many times Min, or Max so many times a load, is close to it
_THIRD = (0.25, 0.5)  # of Max, taken for a third
_REFERENCE_SHARE = 1 / 3  # of the limit of the error, for the uncertainty of a reference mass
_SAME_SPEED = 0.05  # of the planned speed, by which the belt may run at another
_LATE = 1.0  # min, by which a warm-up time may be off
_CALIBRATED = AtRest(0.0, 0.0, 0.0, 0)  # the zero of calibration


@dataclass(frozen=True, slots=True)
class Result:
    """An attempt at a step with its figures, kg; NaN where there is no such figure or limit."""

    attempt: Attempt
    number: int  # of this attempt at the step, from 1
    attempts: int
    count: int = 0  # weighed passes
    required: int = 0  # weighings that the rule asks for
    faults: int = 0
    error: float = math.nan  # mean of the passes, of a zero its distance from the reference
    worst_error: float = math.nan  # largest of a pass, with its sign
    std_dev: float = math.nan
    spread: float = math.nan  # largest less smallest
    uncertainty: float = math.nan  # of the error, k = 2
    coverage: float = math.nan  # share of the stated intervals that hold the error
    max_error: float = math.nan
    max_std_dev: float = math.nan
    failures: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether it was made and kept its limits."""
        return not self.failures and not self.attempt.skipped


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results of all attempts in their order, and what was not done as it is recommended."""

    results: tuple[Result, ...]
    missing: tuple[str, ...]  # names of steps that were not made
    departures: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """Verdict: 'failed', 'incomplete' or 'passed', by the last attempt at each step."""
        if any(each.failures for each in self.last):
            return 'failed'
        return 'incomplete' if self.missing else 'passed'

    @property
    def last(self) -> tuple[Result, ...]:
        """The last attempt at each step."""
        return tuple(each for each in self.results if each.number == each.attempts)


def evaluate(procedure: Procedure) -> Evaluation:
    """Evaluate a procedure."""
    totals = Counter(attempt.step.name for attempt in procedure.attempts)
    made: Counter[str] = Counter()
    zeros = _Zeros(procedure)
    results = []
    for attempt in procedure.attempts:
        name = attempt.step.name
        made[name] += 1
        results.append(judge_attempt(attempt, procedure, zeros, made[name], totals[name]))
    done = {result.attempt.step.name for result in results if not result.attempt.skipped}
    missing = [step.name for step in steps_of(procedure.plan) if step.name not in done]
    return Evaluation(
        tuple(results), tuple(missing), tuple(_departures(procedure, results, missing))
    )


class _Zeros:
    """The readings of zero so far, to which later ones and loads at rest are compared."""

    def __init__(self, procedure: Procedure) -> None:
        self._set = procedure.zeros
        self._read: dict[StepKind, AtRest] = {}
        self.latest = _CALIBRATED

    def reference(self, attempt: Attempt) -> AtRest:
        """Return what a reading of zero is compared with."""
        assert attempt.reading is not None
        if attempt.step.kind == StepKind.WARM_UP_ZERO:
            return self._read.get(StepKind.WARM_UP_ZERO, attempt.reading)
        if attempt.step.kind != StepKind.ZEROING:
            return self._read.get(StepKind.ZEROING, _CALIBRATED)
        before = [each for each in self._set if each.stamp <= attempt.begin]
        return AtRest(before[-1].zero, before[-1].std_dev, 0.0, 0) if before else _CALIBRATED

    def add(self, attempt: Attempt) -> None:
        """Take a reading of zero: of the warm-up the first, of zeroing the last counts."""
        assert attempt.reading is not None
        if attempt.step.kind == StepKind.ZEROING:
            self._read[StepKind.ZEROING] = attempt.reading
        self._read.setdefault(attempt.step.kind, attempt.reading)
        self.latest = attempt.reading


def judge_attempt(
    attempt: Attempt, procedure: Procedure, zeros: _Zeros, number: int, attempts: int
) -> Result:
    """Return the result of an attempt; attempts are judged in their order."""
    blank = Result(attempt, number, attempts)
    accuracy_class = procedure.plan.accuracy_class
    if attempt.skipped:
        return blank
    if attempt.reading is not None:
        return _judge_reading(blank, attempt.reading, accuracy_class, zeros)
    return _JUDGES[attempt.step.kind](_with_figures(blank, accuracy_class), accuracy_class)


def _judge_reading(
    blank: Result, reading: AtRest, accuracy_class: AccuracyClass, zeros: _Zeros
) -> Result:
    if reading.reasons:
        return replace(blank, failures=(f'no reading: {", ".join(reading.reasons)}',))
    load = blank.attempt.step.load
    if load is not None:
        zero, limit = zeros.latest, accuracy_class.max_static_error(load.mass)
        error = reading.mass - zero.mass - load.mass
    else:
        zero = zeros.reference(blank.attempt)
        share = ZERO_ACCURACY if blank.attempt.step.kind == StepKind.ZEROING else ZERO_STABILITY
        limit, error = share * accuracy_class.interval, reading.mass - zero.mass
        zeros.add(blank.attempt)
        if zero is reading:  # the first, which later ones are compared with
            zero, limit = _CALIBRATED, math.inf
    uncertainty = math.hypot(reading.std_error, zero.std_error, load.uncertainty if load else 0)
    failed = not abs(error) <= limit
    return replace(
        blank, error=error, max_error=limit, uncertainty=COVERAGE * uncertainty,
        failures=('the error is beyond its limit',) if failed else (),
    )  # fmt: skip


def _with_figures(blank: Result, accuracy_class: AccuracyClass) -> Result:
    """Return a result with the figures and limits of its passes."""
    step = blank.attempt.step
    assert step.load is not None
    condition = condition_of(blank.attempt)
    errors = condition.errors
    judgement = judge(condition, accuracy_class)
    scatter = condition.std_dev / math.sqrt(condition.count) if condition.count else math.nan
    return replace(
        blank,
        count=condition.count,
        required=judgement.weighings_required,
        faults=condition.faults,
        error=condition.mean_error,
        worst_error=float(errors[np.argmax(np.abs(errors))]) if len(errors) else math.nan,
        std_dev=condition.std_dev,
        spread=float(np.ptp(errors)) if len(errors) else math.nan,
        uncertainty=COVERAGE * math.hypot(scatter, step.load.uncertainty),
        coverage=condition.coverage(LEVEL),
        max_error=judgement.max_error,
        max_std_dev=judgement.max_std_dev,
        failures=tuple(_shortcomings(blank.attempt, condition)),
    )


def condition_of(attempt: Attempt) -> ConditionResult:
    """Return the passes of an attempt as a condition."""
    step = attempt.step
    assert step.load is not None
    assert step.speed is not None
    weighed = [each for each in attempt.passes if each.weighed]
    return ConditionResult(
        'verification', step.speed, step.load.mass, 'test',
        np.array([each.mass - step.load.mass for each in weighed]),
        np.array([each.std_dev for each in weighed]),
        len(attempt.passes) - len(weighed),
    )  # fmt: skip


def _shortcomings(attempt: Attempt, condition: ConditionResult) -> Iterator[str]:
    planned = attempt.step.count
    if condition.count < planned:
        yield f'{condition.count} of {planned} planned weighings'
    if condition.faults:
        yield f'{condition.faults} passes got no mass'
    speeds = [each.speed for each in attempt.passes if each.weighed]
    if speeds and not abs(median(speeds) / condition.speed - 1) <= _SAME_SPEED:
        yield f'the belt ran at {MINUTE * median(speeds):.1f} m/min'


_Judge = Callable[[Result, AccuracyClass], Result]


def _judge_error(result: Result, accuracy_class: AccuracyClass) -> Result:
    """Judge the mean error, of category Y the error of each pass."""
    of_each = accuracy_class.category == 'Y'
    error = result.worst_error if of_each else result.error
    if abs(error) <= result.max_error:
        return result
    what = 'the error of a pass' if of_each else 'the mean error'
    return _failed(result, f'{what} is beyond its limit')


def _judge_std_dev(result: Result) -> Result:
    """Judge the standard deviation, for which category Y has no limit."""
    if result.std_dev <= result.max_std_dev or math.isinf(result.max_std_dev):
        return result
    return _failed(result, 'the standard deviation is beyond its limit')


def _judge_passes(result: Result, accuracy_class: AccuracyClass) -> Result:
    return _judge_std_dev(_judge_error(result, accuracy_class))


def _judge_error_alone(result: Result, accuracy_class: AccuracyClass) -> Result:
    return replace(_judge_error(result, accuracy_class), max_std_dev=math.nan)


def _judge_warm_up(result: Result, accuracy_class: AccuracyClass) -> Result:
    return replace(_judge_error_alone(result, accuracy_class), required=0)


def _judge_repeatability(result: Result, accuracy_class: AccuracyClass) -> Result:
    """Judge the standard deviation, in category Y that the passes agree to within the error."""
    if accuracy_class.category == 'X':
        return replace(_judge_std_dev(result), max_error=math.nan)
    if result.spread <= result.max_error:
        return result
    return _failed(result, 'the spread is beyond the limit of the error')


def _judge_outside(result: Result, accuracy_class: AccuracyClass) -> Result:
    """Judge that no pass got a mass; how far it would have been off does not matter."""
    passes, planned = result.count + result.faults, result.attempt.step.count
    failures = []
    if passes < planned:
        failures.append(f'{passes} of {planned} planned passes')
    if result.count:
        failures.append(f'{result.count} passes got a mass')
    return replace(
        result, required=0, max_error=math.nan, max_std_dev=math.nan, failures=tuple(failures)
    )


def _failed(result: Result, why: str) -> Result:
    return replace(result, failures=(*result.failures, why))


_JUDGES: dict[StepKind, _Judge] = {
    StepKind.WARM_UP: _judge_warm_up,
    StepKind.OUTSIDE: _judge_outside,
    StepKind.PASSES: _judge_passes,
    StepKind.ECCENTRICITY: _judge_error_alone,
    StepKind.REPEATABILITY: _judge_repeatability,
}


def _departures(
    procedure: Procedure, results: Sequence[Result], missing: Sequence[str]
) -> Iterator[str]:
    """Yield a sentence for each thing that is not as recommended."""
    plan = procedure.plan
    for name in missing:
        yield f'Step {name} was not made.'
    for name, there in (
        ('warm-up', plan.warm_up), ('zero', plan.zero_readings),
        ('eccentricity', plan.eccentricity), ('range of dynamic setting', plan.outside),
        ('repeatability', plan.repeatability), ('loads at rest', plan.static),
    ):  # fmt: skip
        if not there:
            yield f'The plan has no test of {name}.'
    if plan.warm_up and plan.warm_up.minutes != WARM_UP_MINUTES:
        given = ', '.join(f'{minutes:g}' for minutes in plan.warm_up.minutes)
        yield f'Warm-up is read at {given} min, not at 0, 5, 15 and 30 min.'
    yield from _load_departures(procedure)
    if procedure.changes is None:
        yield 'Parameters and audit log were not read again after the last step.'
    yield from procedure.changes or ()
    yield from _late_warm_up(results)
    for result in results:
        step = result.attempt.step
        if result.attempts > 1 and result.number == 1:
            yield f'Step {step.name} was made {result.attempts} times; the last one counts.'
        if step.kind in (StepKind.PASSES, StepKind.ECCENTRICITY, StepKind.REPEATABILITY) and (
            0 < result.count < result.required
        ):
            yield f'Step {step.name} has {result.count} weighings, {result.required} are asked for.'


def _load_departures(procedure: Procedure) -> Iterator[str]:
    plan = procedure.plan
    loads = list({each.load.name: each.load for each in plan.passes}.values())
    for group, where in ((loads, 'in motion'), (plan.static, 'at rest')):
        if group and min(load.mass for load in group) > _CLOSE * plan.minimum:
            yield f'No load {where} is close to Min, {GRAMS * plan.minimum:g} g.'
        if group and max(load.mass for load in group) * _CLOSE < plan.maximum:
            yield f'No load {where} is close to Max, {GRAMS * plan.maximum:g} g.'
    if plan.eccentricity:
        share = plan.eccentricity.passes.load.mass / plan.maximum
        if not _THIRD[0] <= share <= _THIRD[1]:
            yield f'The load of eccentricity is {100 * share:.0f} % of Max, not about a third.'
    limits: dict[Mass, float] = {}  # the smallest of the steps that a load is in
    for step in steps_of(plan):
        if step.load is not None and step.kind != StepKind.OUTSIDE:
            own = plan.accuracy_class
            limit = (own.max_static_error if step.at_rest else own.max_error)(step.load.mass)
            limits[step.load] = min(limit, limits.get(step.load, math.inf))
    for load, limit in limits.items():
        expanded, allowed = COVERAGE * load.uncertainty, _REFERENCE_SHARE * limit
        if not expanded <= allowed:
            yield (
                f'Reference {load.name} is known to {GRAMS * expanded:g} g (k = 2), which is above '
                f'a third of the limit, {GRAMS * allowed:.3g} g.'
            )


def _late_warm_up(results: Sequence[Result]) -> Iterator[str]:
    own = [each for each in results if each.attempt.step.minutes is not None]
    for result in own:
        planned, after = result.attempt.step.minutes, minutes_after(result, own[0])
        if planned is not None and not result.attempt.skipped and abs(after - planned) > _LATE:
            yield f'Step {result.attempt.step.name} was made {after:.1f} min after the first.'


def minutes_after(result: Result, first: Result) -> float:
    """Return how long after another attempt one was begun, min."""
    return (result.attempt.begin - first.attempt.begin) / (1e9 * MINUTE)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a procedure: each attempt at a step against the limits of the class.

The rules and their sources:

- Mean error and standard deviation of passes (each error in category Y): the limits of
  `checkweigher_validation.accuracy.classes`, which names their sources.
- Loads at rest: the same source; the limit of category X applies in both categories.
- Zero within 0.25 e after zeroing and within 0.5 e later, loads on other lanes within the error of
  the class, no mass outside the range of dynamic setting: OIML R 51-1:2006, quoted from memory
  because its text was not available.
- A pass without a mass fails its step. This is a rule of this program, so that a machine cannot
  keep its limits by refusing to weigh.

The uncertainty of an error is expanded with k = 2. It has a part from the scatter of the passes and
one from the certificate of the reference mass. It is stated, but not subtracted from the limits.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math
from statistics import median

import numpy as np

from checkweigher_core.records import GRAMS, ZeroChange
from checkweigher_validation.accuracy.classes import AccuracyClass, Judgement, judge
from checkweigher_validation.accuracy.errors import ConditionResult, coverage
from checkweigher_validation.verification.plan import MINUTE, Mass, Plan
from checkweigher_validation.verification.procedure import AtRest, Attempt, Procedure
from checkweigher_validation.verification.steps import StepKind, steps_of

ZERO_ACCURACY, ZERO_STABILITY = 0.25, 0.5  # e
COVERAGE = 2.0  # k of the expanded uncertainty
WARM_UP_MINUTES = (0.0, 5.0, 15.0, 30.0)
LEVEL = 0.95  # probability of the intervals whose coverage is stated

_CLOSE = 1.25  # largest ratio of a load to Min, or of Max to a load, that counts as close
_THIRD = (0.25, 0.5)  # loads that count as a third of Max, relative to Max
_REFERENCE_SHARE = 1 / 3  # largest uncertainty of a reference mass, relative to the limit
_SAME_SPEED = 0.05  # largest relative deviation from the planned belt speed
_LATE = 1.0  # largest deviation of a warm-up time, min
_CALIBRATED = AtRest(0.0, 0.0, 0.0, 0)  # the zero of calibration


@dataclass(frozen=True, slots=True)
class Result:
    """Result of an attempt at a step, in kg; NaN for a figure or limit that does not apply."""

    attempt: Attempt
    number: int  # of this attempt at the step, from 1
    attempts: int  # total at the step
    count: int = 0  # weighed passes
    required: int = 0  # weighings that the rule asks for
    faults: int = 0
    error: float = math.nan  # mean error of the passes, or the change of a zero
    worst_error: float = math.nan  # error of the worst pass, with its sign
    std_dev: float = math.nan
    spread: float = math.nan  # largest error less the smallest
    uncertainty: float = math.nan  # of the error, k = 2
    coverage: float = math.nan  # fraction of the stated intervals that contain the error
    max_error: float = math.nan
    max_std_dev: float = math.nan
    failures: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the attempt was made and is within its limits."""
        return self.verdict == 'passed'

    @property
    def verdict(self) -> str:
        """Verdict: 'skipped', 'failed' or 'passed'."""
        if self.attempt.skipped:
            return 'skipped'
        return 'failed' if self.failures else 'passed'


@dataclass(frozen=True, slots=True)
class AttemptResults:
    """Results of all attempts in their order, and the departures from the recommendations."""

    results: tuple[Result, ...]
    missing: tuple[str, ...]  # names of steps that were not made
    gaps: tuple[str, ...]  # sentences on steps, tests and weighings that are missing
    doubts: tuple[str, ...]  # sentences on the other departures

    @property
    def departures(self) -> tuple[str, ...]:
        """All departures, as sentences."""
        return self.gaps + self.doubts

    @property
    def verdict(self) -> str:
        """Verdict: 'failed', 'incomplete', 'undecided' or 'passed'.

        The last attempt at each step counts. A verification without a failure is incomplete if
        something is missing, and undecided if there is another departure.
        """
        if any(each.failures for each in self.last):
            return 'failed'
        if self.gaps:
            return 'incomplete'
        return 'undecided' if self.doubts else 'passed'

    @property
    def last(self) -> tuple[Result, ...]:
        """The last attempt at each step."""
        return tuple(each for each in self.results if each.number == each.attempts)


def outcome_of(procedure: Procedure) -> AttemptResults:
    """Evaluate a procedure."""
    totals = Counter(attempt.step.name for attempt in procedure.attempts)
    made: Counter[str] = Counter()
    zeros: list[tuple[StepKind, AtRest]] = []  # readings of zero so far
    accuracy_class = procedure.plan.accuracy_class
    results = []
    for attempt in procedure.attempts:
        step, reading = attempt.step, attempt.reading
        made[step.name] += 1
        blank = Result(attempt, made[step.name], totals[step.name])
        if attempt.skipped:
            results.append(blank)
        elif reading is None:
            results.append(_judge_passes(blank, accuracy_class))
        else:
            zero = _zero_for(attempt, procedure.zeros, zeros)
            results.append(_judge_reading(blank, reading, accuracy_class, zero))
        if reading and not reading.reasons and not step.load:
            zeros.append((step.kind, reading))
    done = {result.attempt.step.name for result in results if not result.attempt.skipped}
    missing = tuple(step.name for step in steps_of(procedure.plan) if step.name not in done)
    gaps = tuple(_gaps(procedure.plan, results, missing))
    return AttemptResults(tuple(results), missing, gaps, tuple(_doubts(procedure, results)))


def _zero_for(
    attempt: Attempt, zeroings: Sequence[ZeroChange], zeros: Sequence[tuple[StepKind, AtRest]]
) -> AtRest | None:
    """Return the zero that a reading is compared with; None for the first one of the warm-up."""
    kind = attempt.step.kind
    if kind == StepKind.STATIC:
        return zeros[-1][1] if zeros else _CALIBRATED
    if kind == StepKind.WARM_UP_ZERO:
        return next((zero for of, zero in zeros if of == kind), None)
    if kind == StepKind.ZEROING:
        found = [AtRest(z.zero, z.std_dev, 0.0, 0) for z in zeroings if z.stamp <= attempt.begin]
    else:
        found = [zero for of, zero in zeros if of == StepKind.ZEROING]
    return found[-1] if found else _CALIBRATED


def _judge_reading(
    blank: Result, reading: AtRest, accuracy_class: AccuracyClass, zero: AtRest | None
) -> Result:
    if reading.reasons:
        return replace(blank, failures=(f'no reading: {", ".join(reading.reasons)}',))
    step = blank.attempt.step
    if zero is None:  # the first one, with which the later ones are compared
        return replace(
            blank, error=0.0, max_error=math.inf, uncertainty=COVERAGE * reading.std_error
        )
    if step.load is not None:
        mass, uncertainty = step.load.mass, step.load.uncertainty
        limit = accuracy_class.max_static_error(mass)
    else:
        mass = uncertainty = 0.0
        share = ZERO_ACCURACY if step.kind == StepKind.ZEROING else ZERO_STABILITY
        limit = share * accuracy_class.interval
    error = reading.mass - zero.mass - mass
    return replace(
        blank,
        error=error,
        max_error=limit,
        uncertainty=COVERAGE * math.hypot(reading.std_error, zero.std_error, uncertainty),
        failures=() if abs(error) <= limit else ('the error is beyond its limit',),
    )


def _judge_passes(blank: Result, accuracy_class: AccuracyClass) -> Result:
    """Judge the passes of an attempt by the limits of its test.

    Repeatability is judged by the standard deviation, in category Y by the spread; warm-up and
    eccentricity by the error; other passes within the range by both.
    """
    step, condition = blank.attempt.step, condition_of(blank.attempt)
    result = _with_figures(blank, condition)
    if step.kind == StepKind.OUTSIDE:
        return replace(result, failures=tuple(_shortcomings_outside(condition, step.count)))
    judgement = judge(condition, accuracy_class)
    in_y, repeated = accuracy_class.category == 'Y', step.kind == StepKind.REPEATABILITY
    has_std_dev = step.kind in (StepKind.PASSES, StepKind.REPEATABILITY)
    result = replace(
        result,
        required=0 if step.kind == StepKind.WARM_UP else judgement.weighings_required,
        max_error=judgement.max_error if in_y or not repeated else math.nan,
        max_std_dev=judgement.max_std_dev if has_std_dev else math.nan,
    )
    failures = (*_shortcomings(blank.attempt, condition), *_excesses(result, judgement, in_y))
    return replace(result, failures=failures)


def _excesses(result: Result, judgement: Judgement, in_y: bool) -> Iterator[str]:
    if result.attempt.step.kind != StepKind.REPEATABILITY:
        if not judgement.error_passed:
            yield f'{"the error of a pass" if in_y else "the mean error"} is beyond its limit'
    elif in_y and not result.spread <= result.max_error:
        yield 'the spread is beyond the limit of the error'
    if not math.isnan(result.max_std_dev) and not judgement.std_dev_passed:
        yield 'the standard deviation is beyond its limit'


def _with_figures(blank: Result, condition: ConditionResult) -> Result:
    load, errors = blank.attempt.step.load, condition.errors
    assert load is not None
    scatter = condition.std_dev / math.sqrt(condition.count) if condition.count else math.nan
    return replace(
        blank,
        count=condition.count,
        faults=condition.faults,
        error=condition.mean_error,
        worst_error=float(errors[np.argmax(np.abs(errors))]) if len(errors) else math.nan,
        std_dev=condition.std_dev,
        spread=float(np.ptp(errors)) if len(errors) else math.nan,
        uncertainty=COVERAGE * math.hypot(scatter, load.uncertainty),
        coverage=coverage([condition], LEVEL),
    )


def condition_of(attempt: Attempt) -> ConditionResult:
    """Return the passes of an attempt as a condition."""
    step = attempt.step
    assert step.load is not None
    assert step.speed is not None
    weighed = [each for each in attempt.passes if each.weighed]
    errors = np.array([each.mass - step.load.mass for each in weighed])
    std_devs = np.array([each.std_dev for each in weighed])
    faults = len(attempt.passes) - len(weighed)
    mass = step.load.mass
    return ConditionResult('verification', step.speed, mass, 'test', errors, std_devs, faults)


def _shortcomings(attempt: Attempt, condition: ConditionResult) -> Iterator[str]:
    planned = attempt.step.count
    if condition.count < planned:
        yield f'{condition.count} of {planned} planned weighings'
    if condition.faults:
        yield f'{condition.faults} passes got no mass'
    speeds = [each.speed for each in attempt.passes if each.weighed]
    if speeds and not abs(median(speeds) / condition.speed - 1) <= _SAME_SPEED:
        yield f'the belt ran at {MINUTE * median(speeds):.1f} m/min'


def _shortcomings_outside(condition: ConditionResult, planned: int) -> Iterator[str]:
    """Yield the faults of passes outside the range, which must not get a mass."""
    passes = condition.count + condition.faults
    if passes < planned:
        yield f'{passes} of {planned} planned passes'
    if condition.count:
        yield f'{condition.count} passes got a mass'


def _gaps(plan: Plan, results: Sequence[Result], missing: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each step, test and weighing that is missing."""
    yield from (f'Step {name} was not made.' for name in missing)
    yield from _missing_tests(plan)
    for result in results:
        if 0 < result.count < result.required:
            yield (
                f'Step {result.attempt.step.name} has {result.count} weighings, '
                f'{result.required} are asked for.'
            )


def _doubts(procedure: Procedure, results: Sequence[Result]) -> Iterator[str]:
    """Yield a sentence for each departure that leaves in doubt what was tested."""
    yield from _warm_up_departures(procedure.plan, results)
    yield from _load_departures(procedure.plan)
    yield from _reference_departures(procedure.plan)
    if not procedure.identity.get('audit_log_sha256'):
        yield 'No audit log was read, which would show changes between the steps.'
    if procedure.changes is None:
        yield 'Parameters and audit log were not read again after the last step.'
    yield from procedure.changes or ()
    zeroed = min((zero.stamp for zero in procedure.zeros), default=math.inf)
    for result in results:
        name, attempt = result.attempt.step.name, result.attempt
        if attempt.step.kind == StepKind.ZEROING and attempt.reading and attempt.begin < zeroed:
            yield f'Step {name} followed no zeroing; it was compared with the zero of calibration.'
        if result.attempts > 1 and result.number == 1:
            yield f'Step {name} was made {result.attempts} times; the last one counts.'


def _missing_tests(plan: Plan) -> Iterator[str]:
    tests = {
        'warm-up': plan.warm_up,
        'zero': plan.zero,
        'eccentricity': plan.eccentricity,
        'range of dynamic setting': plan.outside,
        'repeatability': plan.repeatability,
        'loads at rest': plan.static,
    }
    yield from (f'The plan has no test of {name}.' for name, test in tests.items() if not test)


def _load_departures(plan: Plan) -> Iterator[str]:
    in_motion = [plan.references[name] for name in plan.loads]
    for loads, where in ((in_motion, 'in motion'), (plan.static_loads, 'at rest')):
        masses = [load.mass for load in loads]
        if masses and min(masses) > _CLOSE * plan.minimum:
            yield f'No load {where} is close to Min, {plan.min_g:g} g.'
        if masses and max(masses) * _CLOSE < plan.maximum:
            yield f'No load {where} is close to Max, {plan.max_g:g} g.'
    if plan.eccentricity:
        share = plan.references[plan.eccentricity.load].mass / plan.maximum
        if not _THIRD[0] <= share <= _THIRD[1]:
            yield f'The load of eccentricity is {100 * share:.0f} % of Max, not about a third.'


def _reference_departures(plan: Plan) -> Iterator[str]:
    """Yield a sentence for each reference mass that is too uncertain for its limits."""
    own = plan.accuracy_class
    limits: dict[Mass, float] = {}  # smallest limit of the steps of a load
    for step in steps_of(plan):
        if step.load is not None and step.kind != StepKind.OUTSIDE:
            limit = (own.max_static_error if step.at_rest else own.max_error)(step.load.mass)
            limits[step.load] = min(limit, limits.get(step.load, math.inf))
    for load, limit in limits.items():
        expanded, allowed = COVERAGE * load.uncertainty, _REFERENCE_SHARE * limit
        if not expanded <= allowed:
            yield (
                f'Reference {load.name} is known to {GRAMS * expanded:g} g (k = 2), which is above '
                f'a third of the limit, {GRAMS * allowed:.3g} g.'
            )


def _warm_up_departures(plan: Plan, results: Sequence[Result]) -> Iterator[str]:
    if plan.warm_up and plan.warm_up.minutes != WARM_UP_MINUTES:
        given = ', '.join(f'{minutes:g}' for minutes in plan.warm_up.minutes)
        yield f'Warm-up is read at {given} min, not at 0, 5, 15 and 30 min.'
    own = [each for each in results if each.attempt.step.minutes is not None]
    for result in own:
        planned, after = result.attempt.step.minutes, minutes_after(result, own[0])
        if planned is not None and not result.attempt.skipped and abs(after - planned) > _LATE:
            yield f'Step {result.attempt.step.name} was made {after:.1f} min after the first.'


def minutes_after(result: Result, first: Result) -> float:
    """Return the time from the start of another attempt to the start of this one, min."""
    return (result.attempt.begin - first.attempt.begin) / (1e9 * MINUTE)

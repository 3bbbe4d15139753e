# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a verification: comparison of each step with the limits of the accuracy class.

The evaluation follows the rules below.

- In category X, the mean error and the standard deviation of passes are limited. In category Y, the
  error of each pass is limited instead. The module `checkweigher_validation.accuracy.classes`
  contains the limits and their sources.
- The error of a load at rest must be within the limit of the mean error of category X, which
  applies in both categories.
- The first reading of the empty belt after zeroing must be within 0.25 e of the zero that was set,
  where e is the verification scale interval. Later readings of the empty belt must be within 0.5 e
  of the first reading. Readings of the empty belt during the warm-up must be within 0.5 e of the
  first reading of the warm-up. The zero that was set must be within 4 % of Max of the zero of
  calibration. The error of passes beside the middle of the belt must be within the
  limit of the class. Passes outside the range of dynamic setting must not get a mass. The rules on
  zero, eccentricity and range are from OIML R 51-1:2006, quoted from memory because its text was
  not available.
- Inside the range of dynamic setting, a step fails if a pass did not get a mass. This program adds
  the rule on passes without a mass, because otherwise a machine could meet its limits by not
  weighing.

The stated uncertainty of an error is an expanded uncertainty with k = 2. The expanded uncertainty
combines the scatter of the passes, or the standard errors of the reading at rest and of its zero,
with the uncertainty of the reference mass. The uncertainty is not subtracted from the limits.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
import math
from statistics import median

import numpy as np

from checkweigher_core.records import GRAMS, LoadCell, ZeroChange
from checkweigher_validation.accuracy.classes import (
    AccuracyClass,
    Judgement,
    judge,
    weighings_required,
)
from checkweigher_validation.accuracy.errors import ConditionResult, coverage
from checkweigher_validation.verification.plan import MINUTE, Mass, Plan
from checkweigher_validation.verification.procedure import AtRest, Attempt, Procedure, digest_of
from checkweigher_validation.verification.steps import Step, StepKind, steps_of

# Limits, in e, of the zero after zeroing, and of the later changes of the zero.
ZERO_ACCURACY, ZERO_STABILITY = 0.25, 0.5
ZERO_RANGE = 0.04  # largest change of the zero since the calibration, relative to Max
COVERAGE = 2.0  # coverage factor k of the expanded uncertainty
WARM_UP_MINUTES = (0.0, 5.0, 15.0, 30.0)
LEVEL = 0.95  # confidence level of the intervals whose coverage is reported

_CLOSE = 1.25  # largest ratio of a load to Min, or of Max to a load, that counts as close
_THIRD = (0.25, 0.5)  # smallest and largest load that counts as a third of Max, relative to Max.
# Largest expanded uncertainty of a reference mass, relative to the error limit of its steps.
_REFERENCE_SHARE = 1 / 3
_SAME_SPEED = 0.05  # largest relative deviation of the median belt speed from the plan.
# Kinds of steps for which OIML R 51-1 requires a number of weighings.
_COUNTED = StepKind.PASSES, StepKind.ECCENTRICITY, StepKind.REPEATABILITY
_LATE = 1.0  # largest deviation from a planned warm-up time in min.
# Reading of the zero at calibration, which is 0 because readings are relative to this zero.
_CALIBRATED = AtRest(0.0, 0.0, 0.0, 0)


@dataclass(frozen=True, slots=True)
class Result:
    """Result of an attempt at a step. Masses are in kg; a value is NaN if it does not apply."""

    attempt: Attempt
    number: int  # number of this attempt at the step, from 1
    attempts: int  # number of all attempts at the step
    count: int = 0  # number of weighed passes
    required: int = 0  # number of weighings that OIML R 51-1 requires
    faults: int = 0  # number of passes without a mass.
    # Mean error of the passes, error of the load at rest, or change of the zero.
    error: float = math.nan
    worst_error: float = math.nan  # error of a pass with the largest magnitude, with its sign
    std_dev: float = math.nan  # standard deviation of the errors of the passes
    spread: float = math.nan  # difference between the largest and the smallest error
    uncertainty: float = math.nan  # expanded uncertainty of the error, k = 2
    coverage: float = math.nan  # fraction of the errors within the stated 95 % interval
    max_error: float = math.nan  # limit of the magnitude of the error
    max_std_dev: float = math.nan  # limit of the standard deviation
    failures: tuple[str, ...] = ()  # reasons why the attempt failed, empty if it did not fail

    @property
    def passed(self) -> bool:
        """Whether the attempt was made and has no failures."""
        return self.verdict == 'passed'

    @property
    def verdict(self) -> str:
        """Verdict on the attempt: 'skipped', 'failed' or 'passed'."""
        if self.attempt.skipped:
            return 'skipped'
        return 'failed' if self.failures else 'passed'


@dataclass(frozen=True, slots=True)
class AttemptResults:
    """Results of all attempts in chronological order, and the departures from the rules."""

    results: tuple[Result, ...]
    missing: tuple[str, ...]  # names of the steps that were not made
    gaps: tuple[str, ...]  # sentences on missing steps and tests, and on too few weighings
    doubts: tuple[str, ...]  # a sentence for each departure that is not in `gaps`

    @property
    def departures(self) -> tuple[str, ...]:
        """Sentences on all departures."""
        return self.gaps + self.doubts

    @property
    def verdict(self) -> str:
        """Verdict 'failed', 'incomplete', 'undecided' or 'passed'.

        The last attempt that was made at each step counts. If no step failed, the verdict is
        'incomplete' if there are gaps, 'undecided' if there are only doubts, and otherwise
        'passed'.
        """
        if any(each.failures for each in self.last):
            return 'failed'
        if self.gaps:
            return 'incomplete'
        return 'undecided' if self.doubts else 'passed'

    @property
    def last(self) -> tuple[Result, ...]:
        """Result of the last attempt that was made at each step, without the skipped attempts."""
        return _last_of(self.results)


def _last_of(results: Sequence[Result]) -> tuple[Result, ...]:
    made = {each.attempt.step.name: each for each in results if not each.attempt.skipped}
    return tuple(made.values())


def outcome_of(procedure: Procedure) -> AttemptResults:
    """Evaluate all attempts of a verification, and return the results and the departures."""
    totals = Counter(attempt.step.name for attempt in procedure.attempts)
    made: Counter[str] = Counter()
    zeros: list[tuple[StepKind, AtRest]] = []  # kind of step and reading of each zero so far
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
            results.append(_judge_reading(blank, reading, procedure.plan, zero))
        if reading and not reading.reasons and not step.load:
            zeros.append((step.kind, reading))
    done = {result.attempt.step.name for result in results if not result.attempt.skipped}
    missing = tuple(step.name for step in steps_of(procedure.plan) if step.name not in done)
    gaps = tuple(_gaps(procedure.plan, results, missing))
    return AttemptResults(tuple(results), missing, gaps, tuple(_doubts(procedure, results)))


def _zero_for(
    attempt: Attempt, zeroings: Sequence[ZeroChange], zeros: Sequence[tuple[StepKind, AtRest]]
) -> AtRest | None:
    """Return the zero that is subtracted from a reading, or None for the first warm-up reading.

    The zero of a load at rest is the latest reading of the empty belt. The zero of a later warm-up
    reading is the first warm-up reading. The zero of the first reading after zeroing is the last
    zero that was set before. The zero of any other reading is the last valid first reading after
    zeroing. Without a valid reading or a zero that was set, the zero of the calibration is used.
    `zeroings` contains the zeros that were set. `zeros` contains the valid readings of the empty
    belt so far, with the kinds of their steps.
    """
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


def _judge_reading(blank: Result, reading: AtRest, plan: Plan, zero: AtRest | None) -> Result:
    if reading.reasons:
        return replace(blank, failures=(f'no reading: {", ".join(reading.reasons)}',))
    step, accuracy_class = blank.attempt.step, plan.accuracy_class
    if zero is None:  # the first zero of the warm-up, with which the later zeros are compared
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
    failures = [] if abs(error) <= limit else ['the error is beyond its limit']
    if step.kind == StepKind.ZEROING and abs(zero.mass) > ZERO_RANGE * plan.maximum:
        failures.append('the zero differs from that of the calibration by more than 4 % of Max')
    return replace(
        blank,
        error=error,
        max_error=limit,
        uncertainty=COVERAGE * math.hypot(reading.std_error, zero.std_error, uncertainty),
        failures=tuple(failures),
    )


def _judge_passes(blank: Result, accuracy_class: AccuracyClass) -> Result:
    """Return the result of an attempt that consists of passes.

    In a test of repeatability, the standard deviation is limited in category X, and the spread in
    category Y. In tests of warm-up and eccentricity, the error is limited. In a test of the kind
    PASSES, the error is limited, and in category X also the standard deviation. A test inside the
    range of dynamic setting also fails if there are fewer weighings than planned, if a pass got no
    mass, or if the median belt speed differs by more than 5 % from the plan. A test outside the
    range of dynamic setting fails if a pass got a mass, or if there are fewer passes than planned.
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
        required=_required(step),
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
    """Return the errors of the passes of an attempt."""
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
        yield f'{_passes(condition.faults)} got no mass'
    speeds = [each.speed for each in attempt.passes if each.weighed]
    if speeds and not abs(median(speeds) / condition.speed - 1) <= _SAME_SPEED:
        yield f'the belt ran at {MINUTE * median(speeds):.1f} m/min'


def _shortcomings_outside(condition: ConditionResult, planned: int) -> Iterator[str]:
    """Yield the reasons why a test outside the range of dynamic setting fails."""
    passes = condition.count + condition.faults
    if passes < planned:
        yield f'{passes} of {planned} planned passes'
    if condition.count:
        yield f'{_passes(condition.count)} got a mass'


def _passes(count: int) -> str:
    return '1 pass' if count == 1 else f'{count} passes'


def _gaps(plan: Plan, results: Sequence[Result], missing: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each missing step or test, and for each step with too few weighings.

    The last attempt that was made at a step counts. A step without any weighing has failed, and
    gets no sentence.
    """
    yield from (f'Step {name} was not made.' for name in missing)
    yield from _missing_tests(plan)
    for result in _last_of(results):
        if 0 < result.count < result.required:
            yield _too_few(result.attempt.step, result.count, result.required)


def _missing_tests(plan: Plan) -> Iterator[str]:
    # Do not require the warm-up, because it belongs to the type evaluation, and needs a machine
    # that was without power for 8 h.
    tests = {
        'zero': plan.zero,
        'eccentricity': plan.eccentricity,
        'range of dynamic setting': plan.outside,
        'repeatability': plan.repeatability,
        'loads at rest': plan.static,
    }
    yield from (f'The plan has no test of {name}.' for name, test in tests.items() if not test)


def _required(step: Step) -> int:
    """Return the number of weighings that OIML R 51-1 requires for a step, which may be 0."""
    return weighings_required(step.load.mass) if step.load and step.kind in _COUNTED else 0


def _too_few(step: Step, count: int, required: int) -> str:
    return f'Step {step.name} has {count} weighings, {required} are required.'


def plan_departures(plan: Plan, load_cell: LoadCell | None = None) -> Iterator[str]:
    """Yield a sentence for each departure from the rules that a verification by a plan will have.

    A verification with a departure does not get the verdict 'passed', even if each step is within
    its limits. `load_cell` is the load cell of the line, or None if it is not known.
    """
    if load_cell is not None:
        yield from _foreign_device(plan, load_cell)
    yield from _missing_tests(plan)
    for step in steps_of(plan):
        if step.count < _required(step):
            yield _too_few(step, step.count, _required(step))
    yield from _warm_up_times(plan)
    yield from _load_departures(plan)
    yield from _reference_departures(plan)


def _doubts(procedure: Procedure, results: Sequence[Result]) -> Iterator[str]:
    """Yield a sentence for each departure that makes the meaning of a result uncertain.

    If a sentence is yielded, the verdict is 'undecided', unless a step failed or there are gaps.
    """
    yield from _warm_up_departures(procedure.plan, results)
    yield from _load_departures(procedure.plan)
    yield from _reference_departures(procedure.plan)
    if not procedure.identity.get('audit_log_sha256'):
        yield 'No audit log was read, so changes between the steps may be unknown.'
    yield from procedure.conflicts
    yield from _foreign_cell(procedure)
    if procedure.changes is None:
        yield 'Parameters and audit log were not read again after the last step.'
    yield from procedure.changes or ()
    yield from _step_departures(procedure, results)


def _step_departures(procedure: Procedure, results: Sequence[Result]) -> Iterator[str]:
    """Yield a sentence for each step that lacks a zeroing before it, and for each repeated step.

    Only a step of the kind ZEROING needs a zeroing before it.
    """
    zeroed = min((zero.stamp for zero in procedure.zeros), default=math.inf)
    for result in results:
        name, attempt = result.attempt.step.name, result.attempt
        if attempt.step.kind == StepKind.ZEROING and attempt.reading and attempt.begin < zeroed:
            yield f'Step {name} had no zeroing before it; it was compared with the calibrated zero.'
        if result.attempts > 1 and result.number == 1:
            yield f'Step {name} has {result.attempts} attempts; the last that was made counts.'


def _foreign_cell(procedure: Procedure) -> Iterator[str]:
    """Yield a sentence for a wrong load cell, and a sentence for a wrong calibration.

    The load cell is compared with the plan. The calibration in the samples is compared with the
    calibration in the audit log.
    """
    yield from _foreign_device(procedure.plan, procedure.load_cell)
    calibration = procedure.identity.get('audit_log_calibration')
    if calibration not in (None, digest_of(asdict(procedure.load_cell))):
        yield 'The samples have another calibration than the audit log of the machine.'


def _foreign_device(plan: Plan, own: LoadCell) -> Iterator[str]:
    """Yield a sentence if the load cell of the line is not the load cell of the plan.

    `own` is the load cell of the line. The serial number of `own` must be the serial number of the
    load cell or of the amplifier in the plan, because a digital load cell sends the serial number
    of its amplifier.
    """
    planned = [str(each.get('serial', '')) for each in (plan.load_cell, plan.amplifier)]
    if own.serial_number not in filter(None, planned):
        named = f'{own.model} {own.serial_number}'.strip() or 'a device without a serial number'
        yield (
            f'The line has {named}, but the plan has load cell {planned[0] or "?"} and '
            f'amplifier {planned[1] or "?"}.'
        )


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
            yield f'The eccentricity load is {100 * share:.0f} % of Max, not about a third.'


def _reference_departures(plan: Plan) -> Iterator[str]:
    """Yield a sentence for each reference mass that is too uncertain for its smallest limit.

    The expanded uncertainty may be at most a third of the smallest error limit of the steps with
    this mass. Steps outside the range of dynamic setting have no error limit.
    """
    own = plan.accuracy_class
    limits: dict[Mass, float] = {}  # smallest error limit in kg of the steps with each mass
    for step in steps_of(plan):
        if step.load is not None and step.kind != StepKind.OUTSIDE:
            limit = (own.max_static_error if step.at_rest else own.max_error)(step.load.mass)
            limits[step.load] = min(limit, limits.get(step.load, math.inf))
    for load, limit in limits.items():
        expanded, allowed = COVERAGE * load.uncertainty, _REFERENCE_SHARE * limit
        if not expanded <= allowed:
            yield (
                f'Reference {load.name} has an uncertainty of {GRAMS * expanded:g} g (k = 2), '
                f'above a third of the limit, {GRAMS * allowed:.3g} g.'
            )


def _warm_up_times(plan: Plan) -> Iterator[str]:
    if plan.warm_up and plan.warm_up.minutes != WARM_UP_MINUTES:
        given = ', '.join(f'{minutes:g}' for minutes in plan.warm_up.minutes)
        yield f'The warm-up is read at {given} min, not at 0, 5, 15 and 30 min.'


def _warm_up_departures(plan: Plan, results: Sequence[Result]) -> Iterator[str]:
    yield from _warm_up_times(plan)
    own = [each for each in results if each.attempt.step.minutes is not None]
    for result in own:
        planned, after = result.attempt.step.minutes, minutes_after(result, own[0])
        if planned is not None and not result.attempt.skipped and abs(after - planned) > _LATE:
            yield f'Step {result.attempt.step.name} was made {after:.1f} min after the first.'


def minutes_after(result: Result, first: Result) -> float:
    """Return the time in min from the start of the attempt `first` to the start of `result`."""
    return (result.attempt.begin - first.attempt.begin) / (1e9 * MINUTE)

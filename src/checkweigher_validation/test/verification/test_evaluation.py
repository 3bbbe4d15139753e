# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a procedure, compared with numbers worked by hand and by numpy."""

from dataclasses import replace
import math

from made_procedure import CELL, IDENTITY, PLAN, START, attempt_of, procedure_of
import pytest

from checkweigher_core.records import ZeroChange
from checkweigher_validation.verification.evaluation import outcome_of
from checkweigher_validation.verification.plan import EXAMPLE, read_plan
from checkweigher_validation.verification.procedure import AtRest, Attempt, ItemPass, Procedure
from checkweigher_validation.verification.steps import StepKind, steps_of

GRAM = 1e-3
IN_Y = PLAN.replace('class: XIII', 'class: Y(a)')


def test_figures_and_limits_of_passes_are_those_worked_by_hand():
    # Errors of 0.01, 0.03 and 0.05 g: mean 0.03, deviations -0.02, 0, 0.02, so sigma 0.02 g.
    passes = attempt_of('passes_60_small', masses=[74.51, 74.53, 74.55], std_devs=[0.02] * 3)
    result = outcome_of(procedure_of(passes)).results[0]
    assert result.passed
    assert (result.count, result.faults, result.required) == (3, 0, 60)
    assert result.error == pytest.approx(0.03 * GRAM)
    assert result.std_dev == pytest.approx(0.02 * GRAM)
    assert result.spread == pytest.approx(0.04 * GRAM)
    assert result.worst_error == pytest.approx(0.05 * GRAM)
    # XIII(1), e = 0.1 g: 74.5 g is 745 e, so 1 e; up to 100 g sigma may be 0.24 g.
    assert result.max_error == pytest.approx(0.1 * GRAM)
    assert result.max_std_dev == pytest.approx(0.24 * GRAM)
    # k = 2 of the scatter of the mean, 0.02 / sqrt(3), and of the certificate, 0.002 g.
    assert result.uncertainty == pytest.approx(2 * math.hypot(0.02 / 3**0.5, 0.002) * GRAM)
    # 0.05 g is beyond 1.96 x 0.02 g.
    assert result.coverage == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ('name', 'masses', 'faults', 'why'),
    [
        ('passes_60_small', [74.61, 74.61, 74.61], 0, ('the mean error is beyond its limit',)),
        ('passes_60_small', [74.1, 74.5, 74.9], 0, ('the standard deviation is beyond its limit',)),
        ('passes_60_small', [74.5, 74.5], 0, ('2 of 3 planned weighings',)),
        ('passes_60_small', [74.5, 74.5, 74.5], 1, ('1 pass got no mass',)),
        ('eccentricity_left', [194.1, 194.5, 194.9], 0, ()),
        ('eccentricity_left', [194.61] * 3, 0, ('the mean error is beyond its limit',)),
        ('repeatability', [195.5] * 3, 0, ()),
        ('repeatability', [193, 194.5, 196], 0, ('the standard deviation is beyond its limit',)),
        ('outside_1', [], 3, ()),
        ('outside_1', [], 2, ('2 of 3 planned passes',)),
        ('outside_1', [194.5], 2, ('1 pass got a mass',)),
    ],
)
def test_each_test_is_judged_by_its_own_limits(
    name: str, masses: list[float], faults: int, why: tuple[str, ...]
):
    found = outcome_of(procedure_of(attempt_of(name, masses=masses, faults=faults)))
    assert found.results[0].failures == why
    assert found.verdict == ('failed' if why else 'incomplete')


@pytest.mark.parametrize(
    ('plan', 'values', 'failures'),
    [
        # 1.5 e of each at 745 e: a mean of 0 does not help.
        (IN_Y, {'masses': [74.36, 74.5, 74.64]}, ()),
        (IN_Y, {'masses': [74.34, 74.5, 74.66]}, ('the error of a pass is beyond its limit',)),
        (PLAN, {'masses': [74.5] * 3, 'speed': 1.06}, ('the belt ran at 63.6 m/min',)),
    ],
)
def test_category_y_bounds_each_pass_and_the_speed_is_that_of_the_plan(plan, values, failures):
    made = procedure_of(attempt_of('passes_60_small', **values), plan=plan)
    assert outcome_of(made).results[0].failures == failures


def test_category_y_has_a_limit_of_its_own_at_rest():
    # 500 g are 5000 e: 1.5 e at rest, where 2 e are allowed in motion.
    for reading, passed in ((500.149, True), (500.151, False)):
        made = procedure_of(attempt_of('static_up_large', reading=reading), plan=IN_Y)
        (result,) = outcome_of(made).results
        assert result.passed == passed
        assert result.max_error == pytest.approx(0.15 * GRAM)
    # So a mass is held to a third of that: 0.05 g, where motion asks for 0.066 g.
    badly = procedure_of(plan=IN_Y.replace('uncertainty_g: 0.005', 'uncertainty_g: 0.03'))
    assert [each for each in outcome_of(badly).departures if 'Reference' in each] == [
        'Reference large has an uncertainty of 0.06 g (k = 2), above a third of the limit, 0.05 g.'
    ]


@pytest.mark.parametrize('test', ['warm_up', 'eccentricity', 'repeatability', 'static'])
def test_the_references_of_all_tests_are_held_to_their_limits(test: str):
    # 150 g are 1500 e: the limit is 1 e, 0.1 g.
    known = 'large: {mass_g: 500.0, uncertainty_g: 0.005, certificate: C-3, serial: W-3}'
    badly = '  badly: {mass_g: 150, uncertainty_g: 0.02, certificate: C-4, serial: W-4}'
    lines = PLAN.replace(known, f'{known}\n{badly}').splitlines()
    own = next(number for number, line in enumerate(lines) if line.startswith(f'{test}:'))
    lines[own] = lines[own].replace('middle', 'badly').replace('small', 'badly')
    plan = '\n'.join(lines)
    assert 'badly' in lines[own]
    departures = outcome_of(procedure_of(plan=plan)).departures
    told = 'Reference badly has an uncertainty of 0.04 g (k = 2), above a third of the limit'
    assert f'{told}, 0.0333 g.' in departures
    without = plan.replace(lines[own], lines[own].replace('badly', 'middle'))
    assert told not in outcome_of(procedure_of(plan=without)).departures


def test_zeros_are_held_to_the_zero_before_and_loads_to_the_latest():
    readings = [
        ('warm_up_zero_0', 3.0, 'passed'),  # g; the first is the reference of the warm-up
        ('warm_up_zero_1', 3.06, 'failed'),  # 0.5 e are 0.05 g
        ('zero_1', 3.12, 'passed'),  # set to 3.1 g, 0.25 e are 0.025 g
        ('zero_2', 3.165, 'passed'),
        ('static_up_small', 74.5 + 3.165 + 0.09, 'passed'),  # 1 e at 745 e
        ('static_up_large', 500 + 3.165 + 0.16, 'failed'),  # 1.5 e at 5000 e
        ('zero_after', 3.18, 'failed'),
    ]
    attempts = [
        attempt_of(name, reading=reading, begin=START + number)
        for number, (name, reading, _) in enumerate(readings)
    ]
    made = procedure_of(*attempts, zeros=[ZeroChange(START + 2, 3.1 * GRAM, 0.0, 0.0)])
    results = outcome_of(made).results
    assert ['passed' if each.passed else 'failed' for each in results] == [
        verdict for *_, verdict in readings
    ]
    errors = [each.error / GRAM for each in results]
    assert errors == pytest.approx([0, 0.06, 0.02, 0.045, 0.09, 0.16, 0.06], abs=1e-9)
    # A zero that is set with a load on the belt is beyond 4 % of Max, which is 600 g.
    loaded = attempt_of('zero_1', reading=24.1, begin=START + 2)
    zeros = [ZeroChange(START + 2, 24.1 * GRAM, 0.0, 0.0)]
    (failure,) = outcome_of(procedure_of(loaded, zeros=zeros)).results[0].failures
    assert failure == 'the zero differs from that of the calibration by more than 4 % of Max'
    # Without the service the zero of calibration counts.
    alone = outcome_of(procedure_of(attempts[2])).results[0]
    assert alone.error / GRAM == pytest.approx(3.12)


def test_a_reading_that_there_is_none_of_fails():
    attempt = attempt_of('zero_1', reading=0.0)
    assert attempt.reading is not None
    lost = replace(attempt.reading, mass=math.nan, reasons=('SamplesLost',))
    result = outcome_of(procedure_of(replace(attempt, reading=lost))).results[0]
    assert result.failures == ('no reading: SamplesLost',)


def test_the_last_attempt_counts_and_all_are_told():
    masses = ([74.7] * 3, [74.5] * 3)
    found = outcome_of(
        procedure_of(*(attempt_of('passes_60_small', masses=each) for each in masses))
    )
    assert [(each.number, each.passed) for each in found.results] == [(1, False), (2, True)]
    assert [each.number for each in found.last] == [2]
    assert 'Step passes_60_small has 2 attempts; the last that was made counts.' in found.departures
    enough = (attempt_of('passes_60_small', masses=[74.5] * count) for count in (3, 60))
    assert not any('60 are required' in each for each in outcome_of(procedure_of(*enough)).gaps)


def test_what_was_another_one_after_the_last_step_is_told():
    unread = 'Parameters and audit log were not read again after the last step.'
    made = procedure_of()
    assert unread not in outcome_of(made).departures
    assert unread in outcome_of(replace(made, changes=None)).departures
    assert 'It changed.' in outcome_of(replace(made, changes=('It changed.',))).departures


def whole_procedure(text: str = EXAMPLE) -> Procedure:
    """Return a procedure of a plan, with all its steps within their limits."""
    plan = read_plan(text)
    attempts = []
    for number, step in enumerate(steps_of(plan)):
        minutes = 31 + number if step.minutes is None else step.minutes
        begin, mass = START + round(60e9 * minutes), step.load.mass if step.load else 0.0
        reading = AtRest(mass, 1e-6, 1e-5, 960) if step.at_rest else None
        item = ItemPass(begin, mass, 1e-4, step.speed or 0.0, ())
        if step.kind == StepKind.OUTSIDE:
            item = replace(item, mass=math.nan, reasons=('BeltSpeed',))
        passes = () if step.at_rest else (item,) * step.count
        attempts.append(Attempt(step, begin, begin + 1, passes, reading))
    made = procedure_of(*attempts, zeros=[ZeroChange(START, 0.0, 0.0, 1e-6)], plan=text)
    return replace(made, load_cell=replace(CELL, serial_number=plan.amplifier['serial']))


def test_only_a_whole_verification_without_departures_is_passed():
    whole = whole_procedure()
    found = outcome_of(whole)
    assert (found.departures, found.verdict) == ((), 'passed')

    *others, last = whole.attempts
    assert last.reading is not None
    beyond = replace(last, reading=replace(last.reading, mass=last.reading.mass + 1e-3))
    skipped = Attempt(last.step, last.end, last.end, skipped='no time')
    uncertain = EXAMPLE.replace('    uncertainty_g: 0.002', '    uncertainty_g: 0.5')
    for procedure, verdict in (
        (replace(whole, attempts=(*others, beyond)), 'failed'),
        (replace(whole, attempts=tuple(others)), 'incomplete'),
        (whole_procedure(EXAMPLE.replace('# passes: 60', 'passes: 59')), 'incomplete'),
        (whole_procedure(EXAMPLE[: EXAMPLE.index('static:')]), 'incomplete'),
        (whole_procedure(uncertain), 'undecided'),
        (replace(whole, attempts=(*others, beyond, last)), 'undecided'),
        (replace(whole, attempts=(*others, beyond, skipped)), 'failed'),
        (replace(whole, attempts=(*others, last, skipped)), 'undecided'),
        (replace(whole, zeros=()), 'undecided'),
        (replace(whole, load_cell=CELL), 'undecided'),
        (replace(whole, conflicts=('1 mass is not that of the samples.',)), 'undecided'),
        (replace(whole, changes=('It changed.',)), 'undecided'),
        (replace(whole, identity={**IDENTITY, 'audit_log_sha256': None}), 'undecided'),
    ):
        assert outcome_of(procedure).verdict == verdict


def test_departures_from_what_is_recommended_are_told():
    made = procedure_of(
        attempt_of('passes_60_small', masses=[74.5] * 3),
        attempt_of('zero_1', skipped='no time'),
        attempt_of('warm_up_zero_0', reading=0.0, begin=START),
        attempt_of('warm_up_zero_1', reading=0.0, begin=START + 200 * 10**9),
        plan=PLAN.replace('uncertainty_g: 0.005', 'uncertainty_g: 0.03'),
    )
    found = outcome_of(made)
    assert 'zero_1' in found.missing
    for text in (
        'Step zero_1 was not made.',
        'The warm-up is read at 0, 1 min, not at 0, 5, 15 and 30 min.',
        'Step warm_up_zero_1 was made 3.3 min after the first.',
        'Step passes_60_small has 3 weighings, 60 are required.',
        'No load in motion is close to Max, 600 g.',
        'Reference large has an uncertainty of 0.06 g (k = 2), above a third of the limit, 0.05 g.',
    ):
        assert text in found.departures, text
    without = procedure_of(plan=PLAN[: PLAN.index('static:')])
    assert 'The plan has no test of loads at rest.' in outcome_of(without).departures

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plan of a verification and the steps that follow from it."""

from itertools import pairwise

import pytest

from checkweigher_core.parameters import SettingsError
from checkweigher_validation.verification.expectation import expected_duration
from checkweigher_validation.verification.plan import EXAMPLE, LONGEST, read_plan
from checkweigher_validation.verification.steps import StepKind, steps_of


def test_the_example_is_a_plan_in_si_with_weighings_by_load():
    plan = read_plan(EXAMPLE)
    assert plan.accuracy_class.interval == pytest.approx(1e-4)
    assert (plan.minimum, plan.maximum) == pytest.approx((0.06, 0.6))
    assert [load.mass for load in plan.references.values()] == pytest.approx([0.0745, 0.1945, 0.5])
    assert {passes.speed for passes in plan.passes_in_motion} == {0.5, 1.0}
    assert {passes.passes for passes in plan.passes_in_motion} == {60}
    assert [each.nominal for each in plan.prepackages] == pytest.approx([0.25, 0.5])
    assert all(each.suitable for each in plan.prepackages)
    heavier = read_plan(
        EXAMPLE.replace('mass_g: 500.00', 'mass_g: 5000')
        .replace('max_g: 600', 'max_g: 6000')
        .replace('e_g: 0.1', 'e_g: 1')
    )
    assert {passes.load.name: passes.passes for passes in heavier.passes_in_motion}['large'] == 30


def test_steps_go_from_the_warm_up_to_the_zero_after_the_loads():
    steps = steps_of(read_plan(EXAMPLE))
    names = [step.name for step in steps]
    assert len(set(names)) == len(names)
    assert (names[0], names[-1]) == ('warm_up_zero_0', 'zero_after')
    kinds = list(dict.fromkeys(step.kind for step in steps))
    assert kinds == list(StepKind)
    static = [step.name.removeprefix('static_') for step in steps if step.kind == StepKind.STATIC]
    assert static == ['up_small', 'up_middle', 'up_large', 'down_middle', 'down_small']
    first, middle, *_ = (step for step in steps if step.kind == StepKind.PASSES)
    assert first.to_do == (
        'Run the belt at 30 m/min and let one product pass, because the first one after a change '
        'of speed is a FAULT; once the step has begun, let small (74.5 g) pass'
    )
    assert middle.to_do == (
        'Run the belt at 30 m/min; once the step has begun, let middle (194.5 g) pass'
    )
    speeds = [step.speed for step in steps if step.speed]
    new = [step.is_new_speed for step in steps if step.speed]
    assert new == [True, *(a != b for a, b in pairwise(speeds))]


def test_a_plan_takes_as_long_as_its_warm_up_and_what_comes_after():
    # Readings of 5 s: 1 at the end of the warm-up of 30 min, 5 of the zero, 6 at rest. At 1 m/s
    # 10 passes of the warm-up, 180 of the loads, 180 beside the middle and 60 more.
    at_rest, passes = 12 * 5, 0.6 * (430 / 1.0 + 180 / 0.5 + 3 / 2.5)
    assert expected_duration(read_plan(EXAMPLE), 0.6) == pytest.approx(30 * 60 + at_rest + passes)


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('class: XIII', 'class: XV', "line 15: class: class 'XV' is not one of"),
        ('factor: 1 ', 'factor: 1.5 ', '1.5 is not 1, 2 or 5'),
        ('e_g: 0.1 ', 'e_g: 0.01 ', 'e: 0.01 g is below 0.1 g, the smallest of class XIII'),
        ('e_g: 0.1 ', 'e_g: 0.3 ', 'e: 0.3 g is not 1, 2 or 5 x 10^k'),
        ('e_g: 0.1 ', 'e_g: 5 ', 'e: 5 g gives 120 intervals for a Max of 600 g, but class'),
        ('e_g: 0.1 ', 'e_g: 10 ', 'needs at least 500'),
        ('max_g: 600', 'max_g: 50', 'min_g: 60 must be above 0 and below max_g'),
        ('[250, 500]', '[700]', 'prepackages_g: 700 g is above Max, 600 g'),
        ('[250, 500]', '[500, 500]', 'prepackages_g: 500 is listed twice'),
        ('[250, 500]', '[2]', 'prepackages_g: 2 is not in 5..10000'),
        (
            'e_g: 0.1',
            'e_g: 2',
            'prepackages_g: 250 g may be checked by a scale whose error in service is at most '
            '1.8 g (FPackV, Annex 7); that of XIII with e = 2 g is 2 g',
        ),
        ('max_g: 600', 'max_g: 300', 'line 37: loads: large, 500 g, is not between Min and Max'),
        ('loads: [small,', 'loads: [tiny,', "loads: 'tiny' is not one of the references small"),
        ('loads: [small,', 'loads: [large,', 'loads: large is listed twice'),
        ('operator: A. Tester', 'operator: 7', 'operator: 7 is not one line of text'),
        ('operator: A. Tester\n', '', 'operator: is missing'),
        ('in_service: false', 'in_service: 0', 'in_service: 0 is not true or false'),
        ('    mass_g: 74.50', '   # ', 'line 28: references.small.mass_g: is missing'),
        ('readings: 5', 'readings: 2.5', 'zero.readings: 2.5 is not a whole number'),
        ('readings: 5', 'times: 5', 'zero.times: no such key'),
        ('minutes: [0, 5,', 'minutes: [5, 5,', 'warm_up.minutes: must be ascending'),
        ('positions: [left,', 'positions: [right,', 'positions: right is listed twice'),
        ('duration_s: 5 ', 'duration_s: .nan ', 'rest.duration_s: nan is not in'),
        ('machine:  ', 'machine: [', 'line 6: bad YAML: '),
        ('in_service', 'in_servise', 'in_servise: no such key'),
        ('# Plan', '#' * LONGEST, 'at most 10000 are allowed'),
    ],
)
def test_what_is_wrong_in_a_plan_is_named(old: str, new: str, message: str):
    assert old in EXAMPLE
    with pytest.raises(SettingsError) as caught:
        read_plan(EXAMPLE.replace(old, new, 1))
    assert message in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_plan_of_a_newer_format_may_have_keys_that_are_not_known():
    newer = 'format: 2\nclimate: wet\n' + EXAMPLE.replace(
        'mass_g: 74.50', 'mass_g: 74.50\n    box: 3'
    )
    assert read_plan(newer).passes_in_motion == read_plan(EXAMPLE).passes_in_motion
    with pytest.raises(SettingsError, match='line 2: climate: no such key; valid keys are '):
        read_plan(newer.replace('format: 2', 'format: 1'))


def test_what_a_plan_leaves_out_is_the_default():
    rest = EXAMPLE[EXAMPLE.index('rest:') :]
    plan = read_plan(EXAMPLE.replace(rest, '').replace('{readings: 5', '{'))
    assert (plan.rest.duration_s, plan.rest.tolerance) == (5.0, 1e-4)
    assert read_plan(EXAMPLE.replace('factor: 1 ', '# ')).accuracy_class.factor == 1.0

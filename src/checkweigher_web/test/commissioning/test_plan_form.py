# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest
import yaml

from checkweigher_core.records import LoadCell
from checkweigher_validation.verification.plan import EXAMPLE, read_plan
from checkweigher_validation.verification.steps import steps_of
from checkweigher_web.commissioning.coverage import Recorded
from checkweigher_web.commissioning.plan_form import (
    TESTS,
    chosen_tests,
    fields_of,
    new_plan,
    with_test,
    with_value,
    without_mass,
)
from checkweigher_web.commissioning.plan_summary import LineFacts, step_words, summary
from checkweigher_web.languages.language import UNITS, Language, language


def test_the_form_has_what_the_plan_has_and_changes_nothing_else():
    before, text = read_plan(EXAMPLE), EXAMPLE
    values = {field.path: value for field, value in fields_of(text)}
    assert values['class',] == 'XIII'
    assert values['speeds_m_per_min',] == '30, 60'
    assert values['references', 'small', 'mass_g'] == '74.5'
    for path, value in values.items():
        text = with_value(text, path, value)
    assert read_plan(text) == before


def test_values_of_the_form_are_those_of_the_plan():
    text = EXAMPLE
    for path, value in (
        (('operator',), 'B. Other'), (('speeds_m_per_min',), '45; 90,'), (('passes',), '12'),
        (('references', 'small', 'mass_g'), '80,5'), (('references', 'small', 'serial'), '0150'),
    ):  # fmt: skip
        text = with_value(text, path, value)
    plan = read_plan(text)
    assert (plan.operator, plan.speeds_m_per_min, plan.passes) == ('B. Other', (45.0, 90.0), 12)
    small = plan.references['small']
    assert (small.mass_g, small.serial) == (80.5, '0150')
    assert read_plan(with_value(text, ('passes',), '')).passes == 0


@pytest.mark.parametrize('unit', UNITS)
def test_masses_of_the_form_are_in_the_unit_of_the_viewer(unit: str):
    before, text, say = read_plan(EXAMPLE), EXAMPLE, Language('de', unit)
    path = 'references', 'small', 'mass_g'
    shown = {field.path: (value, field.unit) for field, value in fields_of(text, say)}
    assert shown[path] == ({'g': '74,5', 'kg': '0,0745'}.get(unit, shown[path][0]), unit)
    for each, (value, _) in shown.items():
        text = with_value(text, each, value, say)
    assert read_plan(text) == before
    pound = with_value(EXAMPLE, path, '0,25', Language('de', 'lb'))
    assert read_plan(pound).references['small'].mass_g == pytest.approx(113.398, abs=1e-3)


@pytest.mark.parametrize('key', TESTS)
def test_a_test_is_left_out_and_taken_in_again(key: str):
    without = with_test(EXAMPLE, key, made=False)
    assert chosen_tests(without) == {*TESTS} - {key}
    again = with_test(without, key, made=True)
    assert chosen_tests(again) == {*TESTS}
    assert len(steps_of(read_plan(again))) == len(steps_of(read_plan(EXAMPLE)))


NAMEPLATE = 'maker', 'type', 'serial'


def own_plan() -> str:
    """Return the example plan with other persons, places, certificates and serial numbers."""
    text = EXAMPLE
    for field, value in fields_of(EXAMPLE):
        if field.path[-1] in {'operator', 'place', 'environment', *NAMEPLATE, 'certificate'}:
            text = with_value(text, field.path, f'own {value}')
    return text


OWN = own_plan()
CELL = LoadCell(960.0, 5e5, 0.0, -(2**23), 2**23, 7.2, 0.2, 'LC', '007')


@pytest.mark.parametrize('name', ['small', 'middle', 'large'])
def test_a_mass_is_left_out_of_all_tests(name: str):
    plan = read_plan(without_mass(EXAMPLE, name))
    others = [each for each in ('small', 'middle', 'large') if each != name]
    assert [*plan.references] == [*plan.loads] == others
    assert plan.static is not None
    assert [*plan.static.loads] == others
    one_load = (plan.warm_up, plan.eccentricity, plan.repeatability, *plan.outside)
    assert all(test.load in others for test in one_load)


def test_a_plan_says_what_cannot_be_decided():
    text = with_value(OWN, ('references', 'small', 'uncertainty_g'), '0.1')
    line, rows, doubts = summary(text, LineFacts())
    assert line.startswith(f'Steps: {len(rows)}, passes: 643, duration: at least 45 min, with 100 ')
    assert 'at least 39 min, with 60 cm' in summary(text, LineFacts(spacing=0.6))[0]
    departure, doubt = doubts
    assert departure == (
        'This plan cannot pass: Reference small has an uncertainty of 0.2 g (k = 2), above a third '
        'of the limit, 0.0333 g.'
    )
    assert doubt.startswith('Cannot be decided reliably, because the error will be known to 0.2 g')
    assert 'small at 30 m/min, small at 60 m/min, small at rest, loading' in doubt
    assert summary(OWN, LineFacts())[2] == []
    # The mean of 60 passes with a standard deviation of 1 g is known to 0.26 g (k = 2).
    facts = LineFacts(std_dev=lambda mass: 1e-3 if mass < 0.1 else 0.0)
    (doubt,) = summary(OWN, facts)[2]
    assert 'known to 0.258 g (k = 2)' in doubt
    assert 'middle at' not in doubt  # nothing is known of its passes
    line, rows, _ = summary('class: none', LineFacts())
    assert line.startswith('The plan is not complete: line 1')
    assert rows == []


def test_a_plan_says_why_it_cannot_pass():
    assert summary(OWN, LineFacts())[2] == []
    short = with_test(with_value(OWN, ('passes',), '10'), 'warm_up', made=False)
    lines = summary(with_value(short, ('max_g',), '700'), LineFacts())[2]
    assert not any('warm-up' in line for line in lines)
    assert lines[0].startswith('This plan cannot pass: Step small at 30 m/min has 10 weighings')
    assert (
        'This plan cannot pass: Step small at 30 m/min has 10 weighings, 60 are required.' in lines
    )
    assert 'This plan cannot pass: No load in motion is close to Max, 700 g.' in lines
    german = language('de', 'kg')
    assert 'Keine Last in Bewegung ist nahe bei Max, 0,7 kg.' in '; '.join(map(german, lines))


def test_a_new_plan_is_that_of_its_operator_and_line():
    text = new_plan('Eve: B', CELL)
    plan = read_plan(text)
    assert (plan.operator, plan.load_cell) == ('Eve: B', {'type': 'LC', 'serial': '007'})
    assert '# standard uncertainty, from the certificate' in text
    assert new_plan('', None) == new_plan('', replace(CELL, model='', serial_number='')) == EXAMPLE
    line = summary(text, LineFacts(CELL))[2][0]
    assert line.startswith(
        'Not filled in yet, or as in the example plan: Place, Temperature, humidity, pressure, '
    )
    assert line.endswith(', large: serial number')
    assert 'Who verifies' not in line
    assert 'load cell' not in line


def test_a_new_plan_has_the_masses_and_speeds_that_were_recorded():
    passes = [Recorded(1.0, mass, 60, 1.0) for mass in (0.484, 0.1021, 0.2, 0.1021)]
    known = [*passes, Recorded(0.4999, 0.484, 60, 0.8)]
    text = new_plan('Eve', CELL, known, {0.2: 3e-6})
    plan = read_plan(text)
    assert plan.loads == ('102.1g', '200g', '484g') == tuple(plan.references)
    assert [each.mass_g for each in plan.references.values()] == [102.1, 200.0, 484.0]
    assert [each.uncertainty_g for each in plan.references.values()] == [0.0, 0.003, 0.0]
    assert plan.speeds_m_per_min == (30.0, 60.0)
    assert (plan.min_g, plan.max_g, plan.prepackages_g) == (100.0, 490.0, ())
    assert chosen_tests(text) == {*TESTS} - {'warm_up'}
    assert plan.eccentricity is not None
    assert plan.eccentricity.load == '200g'  # about a third of Max
    assert plan.eccentricity.speed_m_per_min == 30
    line, *departures = summary(text, LineFacts(CELL))[2]
    assert departures == []
    assert line.endswith(
        '102.1g: standard uncertainty, 102.1g: certificate, 102.1g: serial number, '
        '200g: certificate, 200g: serial number, '
        '484g: standard uncertainty, 484g: certificate, 484g: serial number'
    )


@pytest.mark.parametrize(
    ('masses', 'speeds', 'expected'),
    [
        ([0.484], [1.0], (480, 1500, 0.2, (60,), 150)),  # a single mass is about a third of Max
        ([0.04, 1.5], [60.4 / 60, 60.6 / 60], (40, 1500, 0.2, (60,), 150)),
        ([0.2, 0.6], [2.0, 160 / 60], (200, 600, 0.1, (120, 160), 200)),
    ],
)
def test_a_new_plan_is_valid_for_all_recorded_masses_and_speeds(masses, speeds, expected):
    known = [Recorded(speed, mass, 60, 1.0) for speed in speeds for mass in masses]
    plan = read_plan(new_plan('Eve', CELL, known))
    (outside,) = plan.outside
    found = plan.min_g, plan.max_g, plan.e_g, plan.speeds_m_per_min, outside.speed_m_per_min
    assert found == expected


def test_a_plan_for_another_load_cell_cannot_pass():
    (line,) = summary(OWN, LineFacts(CELL))[2]
    assert line == (
        'This plan cannot pass: The line has LC 007, but the plan has load cell own '
        'LC-0001 and amplifier own AD-0001.'
    )
    assert language('de', 'g')(line).startswith('Dieser Plan kann nicht zu „bestanden“ führen: Die')
    assert summary(with_value(OWN, ('amplifier', 'serial'), '007'), LineFacts(CELL))[2] == []


def test_a_plan_says_that_the_first_zero_cannot_be_decided():
    assert summary(OWN, LineFacts(zero_std_dev=12e-6))[2] == []
    (line,) = summary(OWN, LineFacts(zero_std_dev=30e-6))[2]
    assert line == (
        'Cannot be decided reliably, because the error will be known to 0.06 g (k = 2), and its '
        'limit is 0.025 g: zero, reading 1. A larger e would help, and for a mass more passes or a '
        'smaller uncertainty.'
    )


def test_a_plan_for_light_prepackages_has_no_heavy_ones():
    text = with_value(EXAMPLE, ('max_g',), '300')
    path = ('prepackages_g',)
    shown = {field.path: value for field, value in fields_of(text)}[path]
    lighter = '; '.join(each for each in shown.split('; ') if float(each) <= 300)
    assert read_plan(EXAMPLE).prepackages_g[-1] > 300
    changed = with_value(text, path, lighter)
    assert all(each <= 300 for each in yaml.safe_load(changed)['prepackages_g'])
    assert 'prepackages_g' not in yaml.safe_load(with_value(text, path, ''))


def test_steps_are_named_in_the_words_of_the_person():
    names = {step.name: step_words(step.name) for step in steps_of(read_plan(EXAMPLE))}
    assert names['static_up_small'] == 'small at rest, loading'
    assert names['passes_30_small'] == 'small at 30 m/min'
    assert names['warm_up_zero_5'] == 'warm-up, zero after 5 min'
    assert names['warm_up_5'] == 'warm-up, passes after 5 min'
    assert not any('_' in words for words in names.values())


@pytest.mark.parametrize(('std_dev', 'e'), [(0.0, 0.1), (7e-6, 0.1), (12e-6, 0.2), (30e-6, 0.5)])
def test_a_new_plan_has_an_interval_with_which_the_zero_can_be_decided(std_dev: float, e: float):
    known = [Recorded(1.0, mass, 60, 1.0) for mass in (0.2, 0.5)]
    plan = read_plan(new_plan('Eve', CELL, known, {}, std_dev))
    assert plan.e_g == e


def test_a_new_plan_for_which_the_class_has_no_interval_says_so():
    text = new_plan('Eve', CELL, [Recorded(1.0, 0.001, 60, 1.0)])
    line, rows, _ = summary(text, LineFacts(CELL))
    assert line.startswith('The plan is not complete: ')
    assert rows == []

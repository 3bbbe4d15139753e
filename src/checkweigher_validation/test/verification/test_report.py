# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of a verification: its schema, its values and its page."""

from importlib.resources import files
import json
import math
import re
from typing import Any

from made_procedure import PLAN, START, attempt_of, procedure_of
import pytest

from checkweigher_validation.report.verification_page import render_verification
from checkweigher_validation.verification.evaluation import outcome_of
from checkweigher_validation.verification.procedure import ItemPass
from checkweigher_validation.verification.report import as_json, report_of

SCHEMA = json.loads(
    (files('checkweigher_validation.verification') / 'report.schema.json').read_text()
)
_TYPES: dict[str, Any] = {'object': dict, 'array': list, 'string': str, 'number': (int, float)}
_TYPES |= {'integer': int, 'boolean': bool, 'null': type(None)}
_KNOWN = {'$schema', 'title', 'description', 'type', 'properties', 'required', 'items', 'enum'}
_KNOWN |= {'additionalProperties', 'pattern', 'minimum'}


def check(schema: dict[str, Any], value: Any, where: str = 'report') -> None:
    """Check that a value satisfies a JSON schema with the keywords of our schema."""
    assert set(schema) <= _KNOWN, where
    types = schema['type'] if isinstance(schema['type'], list) else [schema['type']]
    fits = any(isinstance(value, _TYPES[name]) for name in types)
    assert fits, f'{where}: {value!r} is none of {types}'
    assert not isinstance(value, bool) or 'boolean' in types, where
    assert value in schema.get('enum', [value]), f'{where}: {value!r}'
    if isinstance(value, str):
        assert re.search(schema.get('pattern', ''), value), f'{where}: {value!r}'
    if isinstance(value, (int, float)) and 'minimum' in schema:
        assert value >= schema['minimum'], f'{where}: {value!r}'
    if isinstance(value, list):
        for number, each in enumerate(value):
            check(schema['items'], each, f'{where}[{number}]')
    if isinstance(value, dict):
        known, more = schema.get('properties', {}), schema['additionalProperties']
        assert set(schema.get('required', [])) <= set(value), where
        for name, each in value.items():
            assert name in known or more, f'{where}.{name}: no such key'
            check(known.get(name, more), each, f'{where}.{name}')


@pytest.fixture
def report() -> dict[str, Any]:
    """Return the report of a verification with each kind of result."""
    return report_of(
        procedure_of(
            attempt_of('warm_up_zero_0', reading=0.001),
            attempt_of('outside_1', faults=3),
            attempt_of('passes_60_small', masses=[74.7] * 3, faults=1),
            attempt_of('passes_60_small', masses=[74.51, 74.53, 74.55]),
            attempt_of('eccentricity_left', masses=[]),
            attempt_of('static_up_small', skipped='no <weights>'),
            between=(
                ItemPass(0, math.nan, math.nan, math.nan, ('UnknownItem',)),
                ItemPass(START + 5, math.nan, math.nan, math.nan, ('StartUp', 'MissingEdge')),
            ),
        )
    )


def test_the_json_has_the_form_of_its_schema(report: dict[str, Any]):
    read = json.loads(as_json(report))
    assert read == report
    check(SCHEMA, read)
    for spoil in (
        lambda it: it.pop('verdict'),
        lambda it: it['steps'][0].update(more=1),
        lambda it: it['steps'][0].update(begin='today'),
        lambda it: it['digests'].update(bag='0'),
        lambda it: it['counts'].update(passed=-1),
    ):
        spoilt = json.loads(as_json(report))
        spoil(spoilt)
        with pytest.raises(AssertionError):
            check(SCHEMA, spoilt)


def test_values_are_in_grams_and_utc_and_name_what_was_verified(report: dict[str, Any]):
    first, second = (step for step in report['steps'] if step['name'] == 'passes_60_small')
    assert (first['attempt'], first['verdict'], first['faults']) == (1, 'failed', 1)
    assert (second['attempt'], second['verdict'], second['error_g']) == (2, 'passed', 0.03)
    values = dict(second['passes'][1])
    assert (values.pop('time'), values.pop('reasons')) == ('2026-05-28T20:26:40.000Z', [])
    assert values == {'mass_g': 74.53, 'error_g': 0.03, 'std_dev_g': 0.1, 'speed_m_per_min': 60.0}
    assert first['passes'][3]['mass_g'] is None
    (prepackage,) = report['prepackages']
    assert list(prepackage.values()) == [100.0, 4.5, 0.9, 0.2]
    assert report['verdict'] == 'failed'  # no pass on the left lane
    assert report['digests']['bag'] == 64 * '3'
    assert 'not type-approved' in report['statement']
    assert any('Climate' in each for each in report['not_done'])


def test_the_page_shows_every_reading_and_needs_nothing_else(report: dict[str, Any]):
    page = render_verification(report)
    assert page == render_verification(report)
    for step in report['steps']:
        assert step['name'] in page
    for text in ('failed', 'FPackV', '74.530', '+0.030', 'Unknown', 'no &lt;weights&gt;', 64 * '3'):
        assert text in page, text
    for reason in (*report['departures'], *report['not_done'], report['statement']):
        assert reason.split('<')[0] in page
    assert not re.search(r'(src|href)="(?!#)', page.replace('xlink:href="#', ''))
    assert '@media print' in page


def test_a_verification_over_midnight_shows_the_date_of_each_step():
    hour = 3_600_000_000_000  # ns
    late = [attempt_of('zero_1', reading=0.0, begin=START + n * hour) for n in (0, 4)]
    for attempts, is_dated in ((late[:1], False), (late, True)):
        page = render_verification(report_of(procedure_of(*attempts)))
        assert ('<td>2026-05-28<br>20:26:40</td>' in page) is is_dated
        assert ('<td>2026-05-29<br>00:26:40</td>' in page) is is_dated
        assert 'name in print: A. Tester' in page


def test_faults_between_the_steps_are_listed(report: dict[str, Any]):
    unknown, known = report['faults_between']
    assert list(unknown.values()) == [None, None, ['UnknownItem']]
    assert (known['time'], known['after']) == ('2026-05-28T20:26:40.000Z', 'eccentricity_left')
    assert known['reasons'] == ['StartUp', 'MissingEdge']
    page = render_verification(report)
    assert 'not known' in page
    assert 'StartUp MissingEdge' in page
    later = {**known, 'time': '2026-05-28T20:26:42.000Z'}
    page = render_verification({**report, 'faults_between': [unknown, known, later]})
    assert page.count('StartUp MissingEdge') == 1  # one row, with the first and the last time
    assert '20:26:40.000</td><td class="text">20:26:42.000</td><td>2</td>' in page


def test_a_page_of_nothing_can_be_made():
    made = procedure_of(plan=PLAN)
    assert outcome_of(made).verdict == 'incomplete'
    assert 'incomplete' in render_verification(report_of(made))

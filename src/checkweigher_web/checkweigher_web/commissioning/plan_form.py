# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verification plan as values of a form. Experts can also edit the plan as text."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import yaml

from checkweigher_core.parameters import ParameterError
from checkweigher_core.printable import counted
from checkweigher_core.records import GRAMS
from checkweigher_core.settings_files import plain
from checkweigher_core.yaml_files import opened
from checkweigher_validation.accuracy.classes import CLASSES
from checkweigher_validation.verification.expectation import Expected, expected_uncertainties
from checkweigher_validation.verification.plan import EXAMPLE, read_plan
from checkweigher_validation.verification.steps import StepKind, steps_of


class Field(NamedTuple):
    """Field of the form: path of its key in the plan, label, unit, and choices, if any."""

    path: tuple[str, ...]
    label: str
    unit: str = ''
    choices: tuple[str, ...] = ()


_FIELDS = (
    Field(('operator',), 'Who verifies'),
    Field(('place',), 'Place'),
    Field(('environment',), 'Temperature, humidity, pressure'),
    Field(('class',), 'Accuracy class', choices=tuple(CLASSES)),
    Field(('factor',), 'Class factor x'),
    Field(('e_g',), 'Verification interval e', 'g'),
    Field(('min_g',), 'Min', 'g'),
    Field(('max_g',), 'Max', 'g'),
    Field(('machine', 'serial'), 'Serial number of the machine'),
    Field(('load_cell', 'serial'), 'Serial number of the load cell'),
    Field(('amplifier', 'serial'), 'Serial number of the amplifier'),
    Field(('speeds_m_per_min',), 'Belt speeds', 'm/min'),
    Field(('passes',), 'Passes of each mass (empty: as the rule asks)'),
)
_OF_MASS = (
    ('mass_g', 'mass', 'g'),
    ('uncertainty_g', 'standard uncertainty', 'g'),
    ('certificate', 'certificate', ''),
    ('serial', 'serial number', ''),
)
_NUMBERS = 'factor', 'passes'
# Labels of the tests that a plan may omit, by the keys of their sections.
TESTS = {
    'warm_up': 'Warm-up',
    'zero': 'Zero',
    'outside': 'Outside the range of speeds',
    'eccentricity': 'Eccentricity',
    'repeatability': 'Repeatability',
    'static': 'Masses at rest',
}


def fields_of(text: str) -> list[tuple[Field, str]]:
    """Return the fields of the form for a plan, each with its value.

    Raises `ParameterError` if the text is not YAML with sections.
    """
    plan = _sections(text)
    masses = plan.get('references')
    names = list(masses) if isinstance(masses, dict) else []
    of_masses = (
        Field(('references', name, key), f'{name}: {label}', unit)
        for name in names
        for key, label, unit in _OF_MASS
    )
    return [(field, _value(plan, field.path)) for field in (*_FIELDS, *of_masses)]


def chosen_tests(text: str) -> set[str]:
    """Return the keys of the tests in a plan. Raises `ParameterError` as `fields_of`."""
    return {key for key in TESTS if _sections(text).get(key)}


def with_value(text: str, path: tuple[str, ...], value: str) -> str:
    """Return the text of a plan with a new value of a field. An empty value removes the key."""
    plan = section = _sections(text)
    for key in path[:-1]:
        section = section.setdefault(key, {})
    if value.strip():
        section[path[-1]] = _typed(path[-1], value)
    else:
        section.pop(path[-1], None)
    return _dumped(plan)


def with_test(text: str, key: str, *, made: bool) -> str:
    """Return the text of a plan with or without a test.

    An added test is a copy of the test in the example plan, with a reference mass and a speed of
    this plan.
    """
    plan = _sections(text)
    plan.pop(key, None)
    if made:
        load, *_ = plan.get('loads') or ['']
        speed, *_ = plan.get('speeds_m_per_min') or [0.0]
        plan[key] = _fitted(_sections(EXAMPLE)[key], plan.get('loads') or [], load, speed)
    return _dumped(plan)


def _fitted(section: Any, loads: Iterable[str], load: str, speed: float) -> Any:
    """Return a section of the example plan with the reference masses and speed of another plan."""
    if isinstance(section, list):
        return [{**each, 'load': load} for each in section]
    own = {'load': load, 'loads': list(loads), 'speed_m_per_min': speed}
    return {key: own.get(key, value) for key, value in section.items()}


def summary(text: str, std_dev: float) -> tuple[str, list[tuple[str, ...]], list[str]]:
    """Return a summary of a plan, its steps as rows, and lines on the steps without a decision.

    `std_dev` is the standard deviation of a pass in kg, or 0 if it is not known. If the plan is not
    valid, the summary is the error, and there are no rows.
    """
    try:
        plan = read_plan(text)
    except ParameterError as error:
        return f'The plan is not complete: {error}', [], []
    steps = steps_of(plan)
    rows: list[tuple[str, ...]] = [
        (step_words(step.name), f'{step.count} passes: {step.to_do}' if step.count else step.to_do)
        for step in steps
    ]
    passes = sum(step.count for step in steps)
    line = f'{counted(len(steps), "step")} with {passes} passes'
    return line, rows, list(_doubts(expected_uncertainties(plan, std_dev)))


def _doubts(expected: Iterable[Expected]) -> Iterator[str]:
    """Yield a line for each reason why steps cannot be decided, with the names of the steps."""
    names: dict[str, list[str]] = {}
    for each in expected:
        if not each.is_decidable:
            why = (
                f'the error will be known to {GRAMS * each.uncertainty:.3g} g (k = 2), and its '
                f'limit is {GRAMS * each.limit:.3g} g'
            )
            names.setdefault(why, []).append(step_words(each.step.name))
    for why, steps in names.items():
        yield f'Cannot be decided, because {why}: {", ".join(steps)}'


def step_words(name: str) -> str:
    """Return the name of a verification step as plain text for the user."""
    kind, _, rest = name.partition('_')
    first, _, last = rest.partition('_')
    match kind, first:
        case 'static', 'up' | 'down':
            return f'{last} at rest, {"loading" if first == "up" else "unloading"}'
        case 'passes', _:
            return f'{last} at {first} m/min'
        case 'warm', _:
            *zero, minutes = last.split('_')
            return f'warm-up, {"zero" if zero else "passes"} after {minutes} min'
        case 'zero', 'after':
            return str(StepKind.ZERO_AFTER)
        case 'zero', _:
            return f'zero, reading {rest}'
        case 'outside', _:
            return f'outside the range of speeds, {rest}'
        case 'eccentricity', _:
            return f'beside the middle: {rest}'
    return name


def _sections(text: str) -> dict[str, Any]:
    with opened(text) as content:
        found = plain(content)
    if not isinstance(found, dict):
        raise ParameterError('it has no keys')
    return found


def _value(plan: Mapping[str, Any], path: tuple[str, ...]) -> str:
    found: Any = plan
    for key in path:
        found = found.get(key, '') if isinstance(found, Mapping) else ''
    return ', '.join(map(str, found)) if isinstance(found, list) else str(found)


def _typed(key: str, value: str) -> Any:
    """Return the value of a key in the type that the plan needs: a list, a number or a text."""
    if key == 'speeds_m_per_min':
        return [_number(each) for each in value.replace(';', ',').split(',') if each.strip()]
    return _number(value) if key.endswith('_g') or key in _NUMBERS else value.strip()


def _number(value: str) -> float | int | str:
    """Return a number, or an invalid number as text, which the check of the plan refuses."""
    try:
        number = float(value.strip().replace(',', '.'))
    except ValueError:
        return value.strip()
    return int(number) if number.is_integer() else number


def _dumped(plan: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(plan), sort_keys=False, allow_unicode=True)

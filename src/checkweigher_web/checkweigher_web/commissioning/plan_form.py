# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Form for a verification plan. A change in the form changes the text of the plan."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
import json
import math
from types import MappingProxyType
from typing import Any, NamedTuple

import yaml

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import GRAMS, LoadCell
from checkweigher_core.settings_files import plain
from checkweigher_core.yaml_files import opened
from checkweigher_validation.accuracy.classes import CLASSES, smallest_interval
from checkweigher_validation.verification.evaluation import COVERAGE, ZERO_ACCURACY
from checkweigher_validation.verification.plan import EXAMPLE, MINUTE
from checkweigher_web.commissioning.coverage import SAME_SPEED, Recorded
from checkweigher_web.languages.language import ENGLISH, Language, Text


class Field(NamedTuple):
    """Field of the form: path of its key in the plan, label, unit, and choices if there are any."""

    path: tuple[str, ...]
    label: Text
    unit: str = ''
    choices: tuple[str, ...] = ()


_FIELDS = (
    Field(('operator',), Text('Who verifies')),
    Field(('place',), Text('Place')),
    Field(('environment',), Text('Temperature, humidity, pressure')),
    Field(('class',), Text('Accuracy class'), choices=tuple(CLASSES)),
    Field(('factor',), Text('Class factor x')),
    Field(('e_g',), Text('Verification interval e')),
    Field(('min_g',), Text('Min')),
    Field(('max_g',), Text('Max')),
    Field(('prepackages_g',), Text('Nominal quantities of prepackages (empty: none)')),
    Field(('machine', 'maker'), Text('Maker of the machine')),
    Field(('machine', 'type'), Text('Type of the machine')),
    Field(('machine', 'serial'), Text('Serial number of the machine')),
    Field(('load_cell', 'type'), Text('Type of the load cell')),
    Field(('load_cell', 'serial'), Text('Serial number of the load cell')),
    Field(('amplifier', 'type'), Text('Type of the amplifier')),
    Field(('amplifier', 'serial'), Text('Serial number of the amplifier')),
    Field(('speeds_m_per_min',), Text('Belt speeds'), 'm/min'),
    Field(('passes',), Text('Passes of each mass (empty: as the rule asks)')),
)
_OF_MASS = (
    ('mass_g', Text('mass')),
    ('uncertainty_g', Text('standard uncertainty')),
    ('certificate', Text('certificate')),
    ('serial', Text('serial number')),
)
_NUMBERS = 'factor', 'passes'
# Keys whose values differ between verifications. The page names the keys that still have the value
# of the example plan.
_OWN = 'operator', 'place', 'environment', 'maker', 'type', 'certificate', 'serial'
# Largest ratio of the uncertainty of the first zero to its limit in a new plan. It is below 1,
# because the standard deviation of a single reading is itself uncertain.
_SURE = 0.8
_OUTSIDE = 1.25  # smallest ratio of a speed outside the range to the highest speed of the plan
# Values of a recorded mass in a new plan. The page lists these fields until the user fills them in.
_UNKNOWN = {'certificate': '?', 'serial': '?', 'uncertainty_g': 0}
# Labels of the tests that a plan may omit, by the keys of their sections.
TESTS = {
    'warm_up': Text('Warm-up, for a type evaluation'),
    'zero': Text('Zero'),
    'outside': Text('Outside the range of speeds'),
    'eccentricity': Text('Eccentricity'),
    'repeatability': Text('Repeatability'),
    'static': Text('Masses at rest'),
}


def new_plan(
    operator: str,
    load_cell: LoadCell | None,
    passes: Sequence[Recorded] = (),
    uncertainties: Mapping[float, float] = MappingProxyType({}),
    zero_std_dev: float = 0.0,
) -> str:
    """Return the example plan with an operator, a load cell, and recorded masses and speeds.

    A value that is empty does not replace the value of the example. If `load_cell` is None, its
    type and serial number count as empty. `passes` are the passes that were recorded for training.
    Without recorded passes, the plan keeps the masses, speeds and tests of the example. Otherwise
    Min and Max are close to the lightest and the heaviest recorded mass, and the plan has no
    warm-up, which only a type evaluation needs, and e is so large that the zero can be decided with
    its standard deviation `zero_std_dev` in kg. `uncertainties` contains known standard
    uncertainties in kg by the mass in kg.
    """
    text, example = EXAMPLE, _values_of_example()
    model, serial = (load_cell.model, load_cell.serial_number) if load_cell else ('', '')
    known = {
        ('operator',): operator,
        ('load_cell', 'type'): model,
        ('load_cell', 'serial'): serial,
    }
    for path, value in known.items():
        before = example[path]
        if value:  # Replace the text of the value, because the comments of the plan must stay.
            text = text.replace(f': {before}\n', f': {json.dumps(value)}\n')
    return _with_recorded(text, passes, uncertainties, zero_std_dev) if passes else text


def _with_recorded(
    text: str,
    passes: Sequence[Recorded],
    uncertainties: Mapping[float, float],
    zero_std_dev: float,
) -> str:
    plan = _sections(text)
    in_grams = {round(GRAMS * mass, 3): value for mass, value in uncertainties.items()}
    masses = sorted({round(GRAMS * each.mass, 3) for each in passes})
    plan['references'] = {
        f'{mass:g}g': {
            'mass_g': _number(str(mass)),
            **_UNKNOWN,
            'uncertainty_g': _number(f'{GRAMS * in_grams.get(mass, 0.0):g}'),
        }
        for mass in masses
    }
    plan['loads'] = list(plan['references'])
    plan['speeds_m_per_min'] = speeds = _distinct([MINUTE * each.speed for each in passes])
    heaviest = masses[-1] if len(masses) > 1 else 3 * masses[0]  # above a single mass
    plan['min_g'], plan['max_g'] = _round_down(masses[0]), -_round_down(-heaviest)
    with suppress(ValueError):  # The class allows no e, which the check of the plan reports.
        smallest = GRAMS * smallest_interval(plan['class'], plan['max_g'] / GRAMS)
        plan['e_g'] = max(plan['e_g'], _number(f'{smallest:.6g}'))
    # The first zero is compared with a reading that has about the same standard deviation.
    uncertainty = COVERAGE * math.sqrt(2) * GRAMS * zero_std_dev
    while uncertainty > _SURE * ZERO_ACCURACY * plan['e_g']:
        plan['e_g'] = _number(f'{_larger_interval(plan["e_g"]):.6g}')
    for each in plan['outside']:
        each['speed_m_per_min'] = max(each['speed_m_per_min'], round(_OUTSIDE * speeds[-1]))
    del plan['prepackages_g'], plan['warm_up']
    for key in TESTS & plan.keys():
        plan[key] = _fitted(plan[key], plan)
    return _dumped(plan)


def _larger_interval(interval: float) -> float:
    """Return the next larger one of the intervals 1, 2 and 5 times 10^k."""
    power = 10.0 ** math.floor(math.log10(interval) + 1e-9)
    return power * next(each for each in (2, 5, 10) if each > interval / power * (1 + 1e-9))


def _distinct(speeds: Iterable[float]) -> list[int]:
    """Return ascending belt speeds in m/min, without those that count as equal to a lower one."""
    found: list[float] = []
    for speed in sorted(speeds):
        if not found or speed > (1 + SAME_SPEED) * found[-1]:
            found.append(speed)
    return [round(speed) for speed in found]


def _round_down(mass: float) -> float:
    """Return the largest number with two digits that is not above a mass in g."""
    step = 10.0 ** (math.floor(math.log10(abs(mass))) - 1)
    return float(f'{step * math.floor(mass / step):.6g}')


@cache
def _values_of_example() -> dict[tuple[str, ...], str]:
    return {field.path: value for field, value in fields_of(EXAMPLE)}


def fields_of(text: str, say: Language = ENGLISH) -> list[tuple[Field, str]]:
    """Return the fields of the form for the text of a plan, each with its value.

    Masses are in the unit of `say`. Raises `ParameterError` if the text is not a YAML mapping.
    """
    plan = _sections(text)
    masses = plan.get('references')
    names = list(masses) if isinstance(masses, dict) else []
    of_masses = (
        Field(('references', name, key), Text('{name}: {label}', name=name, label=label))
        for name in names
        for key, label in _OF_MASS
    )
    fields = (_in_unit(field, say) for field in (*_FIELDS, *of_masses))
    return [(field, _value(plan, field.path, say)) for field in fields]


def chosen_tests(text: str) -> set[str]:
    """Return the keys of the tests in a plan.

    Raises `ParameterError` if the text is not a YAML mapping.
    """
    return {key for key in TESTS if _sections(text).get(key)}


def with_value(text: str, path: tuple[str, ...], value: str, say: Language = ENGLISH) -> str:
    """Return the text of a plan with a new value for a field. An empty value removes the key.

    The value of a mass is in the unit of `say`, and is converted to g for the plan. If a number is
    needed and the value is not a number, the value is kept as text, and the check of the plan
    rejects the plan. Raises `ParameterError` if the text of the plan is not a YAML mapping.
    """
    plan = section = _sections(text)
    for key in path[:-1]:
        section = section.setdefault(key, {})
    if value.strip():
        section[path[-1]] = _typed(path[-1], value, say)
    else:
        section.pop(path[-1], None)
    return _dumped(plan)


def with_test(text: str, key: str, *, made: bool) -> str:
    """Return the text of a plan with a test if `made` is true, otherwise without the test.

    An added test is a copy of the test in the example plan, with the loads and the first speed of
    this plan. A test with one load gets the load nearest to a third of Max. Raises `ParameterError`
    if the text is not a YAML mapping.
    """
    plan = _sections(text)
    plan.pop(key, None)
    if made:
        plan[key] = _fitted(_sections(EXAMPLE)[key], plan)
    return _dumped(plan)


def _fitted(section: Any, plan: Mapping[str, Any]) -> Any:
    """Return the section of a test of another plan with the loads and the speed of a plan.

    Keys that the section does not contain are not added. If the section is a list, only the load of
    each entry is replaced.
    """
    load = _third_of_max(plan)
    if isinstance(section, list):
        return [{**each, 'load': load} for each in section]
    speed, *_ = plan.get('speeds_m_per_min') or [0.0]
    own = {'load': load, 'loads': list(plan.get('loads') or ()), 'speed_m_per_min': speed}
    return {key: own.get(key, value) for key, value in section.items()}


def without_mass(text: str, name: str) -> str:
    """Return the text of a plan without a reference mass.

    A test whose only load is this mass gets the remaining load that is nearest to a third of Max.
    Raises `ParameterError` if the text is not a YAML mapping.
    """
    plan = _sections(text)
    plan['references'] = {k: v for k, v in (plan.get('references') or {}).items() if k != name}
    plan['loads'] = loads = [each for each in plan.get('loads') or [] if each != name]
    for section in _tests_in(plan):
        if section.get('load') == name and loads:
            section['load'] = _third_of_max(plan)
        if isinstance(section.get('loads'), list):
            section['loads'] = [each for each in section['loads'] if each != name]
    return _dumped(plan)


def _third_of_max(plan: Mapping[str, Any]) -> str:
    """Return the load nearest to a third of Max, or the middle one if masses are not numbers."""
    loads = plan.get('loads') or ['']
    try:
        third, references = plan['max_g'] / 3, plan['references']
        return min(loads, key=lambda each: abs(math.log(references[each]['mass_g'] / third)))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return str(loads[len(loads) // 2])


def _tests_in(plan: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the section of each test, or each entry of the section if the section is a list."""
    for key in TESTS:
        section = plan.get(key)
        for each in section if isinstance(section, list) else [section]:
            if isinstance(each, dict):
                yield each


def not_given(text: str) -> list[Text]:
    """Return the labels of the fields that still have a value of the example or of a new plan."""
    example = _values_of_example()
    return [
        field.label
        for field, value in fields_of(text)
        if value == str(_UNKNOWN.get(field.path[-1]))
        or (field.path[-1] in _OWN and value == example.get(field.path))
    ]


def _sections(text: str) -> dict[str, Any]:
    with opened(text) as content:
        found = plain(content)
    if not isinstance(found, dict):
        raise ParameterError('the plan must be a YAML mapping of keys to values')
    return found


def _in_unit(field: Field, say: Language) -> Field:
    return field._replace(unit=say.unit) if _is_mass(field.path[-1]) else field


def _is_mass(key: str) -> bool:
    return key.endswith('_g')


def _value(plan: Mapping[str, Any], path: tuple[str, ...], say: Language) -> str:
    found: Any = plan
    for key in path:
        found = found.get(key, '') if isinstance(found, Mapping) else ''
    if _is_mass(path[-1]) and isinstance(found, (int, float, list)):
        masses = found if isinstance(found, list) else [found]
        return '; '.join(say.entry(say.per_kg * each / GRAMS) for each in masses)
    return ', '.join(map(str, found)) if isinstance(found, list) else str(found)


def _typed(key: str, value: str, say: Language) -> Any:
    """Return the value of a key with the type that the plan needs: a list, a number or a text."""
    if key == 'speeds_m_per_min':
        return [_number(each) for each in value.replace(';', ',').split(',') if each.strip()]
    if key == 'prepackages_g':
        return [_grams(each, say) for each in value.split(';') if each.strip()]
    if _is_mass(key):
        return _grams(value, say)
    return _number(value) if key in _NUMBERS else value.strip()


def _grams(value: str, say: Language) -> float | int | str:
    """Return a mass in g for a value in the unit of `say`, or the value if it is not a number."""
    number = _number(value)
    if isinstance(number, str):
        return number
    # `Language.entry` shows a mass with 9 significant digits. Rounding to 8 digits restores the
    # mass in g.
    return _number(f'{GRAMS / say.per_kg * number:.8g}')


def _number(value: str) -> float | int | str:
    """Return the number in a text, in which a comma counts as a decimal point.

    A text that is not a number is returned unchanged, and the check of the plan rejects the plan.
    """
    try:
        number = float(value.strip().replace(',', '.'))
    except ValueError:
        return value.strip()
    return int(number) if number.is_integer() else number


def _dumped(plan: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(plan), sort_keys=False, allow_unicode=True)

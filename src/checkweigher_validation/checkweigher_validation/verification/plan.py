# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plan of a verification: what is verified, to which class, with which masses, in which tests.

It is one YAML file; `EXAMPLE` is one with a comment at each key. Masses in it are in grams and
speeds in m/min, as the keys say, and become kg and m/s here. A test whose section is left out is
not done, and the report says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
import math
import re
from typing import cast

from checkweigher_dsp.production.prepackages import LARGEST, SMALLEST
from checkweigher_dsp.records import GRAMS
from checkweigher_dsp.yaml_files import parse_yaml
from checkweigher_validation.accuracy.classes import (
    AccuracyClass,
    Suitability,
    check_range,
    suitability,
    weighings_required,
)

EXAMPLE = (files(__package__) / 'example_plan.yaml').read_text(encoding='utf-8')
LONGEST = 10_000  # characters; the text of a message
MINUTE = 60.0  # s
PLANS, VERIFICATIONS = 'plans', 'verifications'  # where these are, in the folder of a machine

_MOST_PASSES, _MOST_MINUTES, _MOST_READINGS, _MOST_SECONDS = 10_000, 24 * 60, 100, 60
_LARGEST_G, _FASTEST = 1e7, 600.0  # g, m/min
_ROUNDING = 1 + 1e-9


class PlanError(ValueError):
    """A plan that cannot be used; one line that names the key, the value and what is allowed."""


@dataclass(frozen=True, slots=True)
class Mass:
    """A reference mass with its certificate; kg."""

    name: str  # by which the plan calls it
    mass: float
    uncertainty: float  # standard
    certificate: str
    serial: str


@dataclass(frozen=True, slots=True)
class Passes:
    """Passes of one load at one belt speed."""

    load: Mass
    speed: float  # m/s
    count: int


@dataclass(frozen=True, slots=True)
class WarmUp:
    """Zero and passes of one load at some times after the machine was switched on."""

    minutes: tuple[float, ...]
    passes: Passes


@dataclass(frozen=True, slots=True)
class Eccentricity:
    """Passes of one load on lanes beside the middle of the belt."""

    positions: tuple[str, ...]
    passes: Passes


@dataclass(frozen=True, slots=True)
class Plan:
    """What is verified, and the tests that are made; None or empty for a test that is not."""

    machine: Mapping[str, str]
    load_cell: Mapping[str, str]
    amplifier: Mapping[str, str]
    accuracy_class: AccuracyClass
    minimum: float  # Min, kg
    maximum: float  # Max, kg
    prepackages: tuple[Suitability, ...]  # those that it is to check, each found suitable
    operator: str
    place: str
    environment: str
    masses: tuple[Mass, ...]
    passes: tuple[Passes, ...]  # each load at each speed
    warm_up: WarmUp | None
    zero_readings: int
    outside: tuple[Passes, ...]  # beyond the range of dynamic setting
    eccentricity: Eccentricity | None
    repeatability: Passes | None
    static: tuple[Mass, ...]
    duration: float  # s, for which a load at rest is read
    tolerance: float  # kg, by which a load at rest may still move


def read_plan(text: str) -> Plan:
    """Return the plan of a YAML text; `PlanError` names the first key that cannot be used."""
    if len(text) > LONGEST:
        raise PlanError(f'{len(text)} characters, at most {LONGEST}: shorten the comments')
    try:
        content = parse_yaml(text)
    except ValueError as error:
        raise PlanError(f'no YAML: {error}') from None
    section = _Section('', content)
    plan = _plan(section)
    section.finish()
    return plan


class _Section:
    """A mapping of the file whose keys are taken one after the other."""

    def __init__(self, name: str, content: object) -> None:
        if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
            raise PlanError(f'{name or "the plan"}: must be "key: value" lines')
        self._prefix = f'{name}.' if name else ''
        self._left = cast(dict[str, object], dict(content))

    def key(self, name: str) -> str:
        """Return the name of a key as errors show it."""
        return self._prefix + name

    def has(self, name: str) -> bool:
        """Whether a key is there and not taken."""
        return name in self._left

    def names(self) -> list[str]:
        """Return the keys that are not taken."""
        return list(self._left)

    def take(self, name: str) -> object:
        """Return a value as it stands in the file."""
        if name not in self._left:
            raise PlanError(f'{self.key(name)}: is missing')
        return self._left.pop(name)

    def text(self, name: str) -> str:
        """Return a text of one line."""
        value = self.take(name)
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise PlanError(f'{self.key(name)}: {value!r} is not one line of text; quote it')
        return value

    def number(self, name: str, low: float, high: float, default: float | None = None) -> float:
        """Return a number within bounds."""
        if default is not None and not self.has(name):
            return default
        return _number(self.key(name), self.take(name), low, high)

    def whole(self, name: str, high: int, default: int) -> int:
        """Return a whole number from 1."""
        value = self.number(name, 1, high, default)
        if value != int(value):
            raise PlanError(f'{self.key(name)}: {value:g} is not whole')
        return int(value)

    def flag(self, name: str) -> bool:
        """Return true or false, false by default."""
        value = self.take(name) if self.has(name) else False
        if not isinstance(value, bool):
            raise PlanError(f'{self.key(name)}: {value!r} is neither true nor false')
        return value

    def list_of(self, name: str) -> list[object]:
        """Return the values of a list with at least one."""
        value = self.take(name)
        if not isinstance(value, list) or not value:
            raise PlanError(f'{self.key(name)}: {value!r} is not a list like [a, b]')
        return value

    def section(self, name: str) -> '_Section':
        """Return a mapping within."""
        return _Section(self.key(name), self.take(name))

    def texts(self, name: str) -> dict[str, str]:
        """Return a mapping of texts."""
        section = self.section(name)
        return {key: section.text(key) for key in section.names()}

    def finish(self) -> None:
        """Refuse keys that nobody took."""
        for name in self._left:
            raise PlanError(f'{self.key(name)}: no such key')


def _plan(section: _Section) -> Plan:
    accuracy_class = _accuracy_class(section)
    minimum = section.number('min_g', 0, _LARGEST_G) / GRAMS
    maximum = section.number('max_g', 0, _LARGEST_G) / GRAMS
    _check_range(accuracy_class, minimum, maximum)
    masses = _masses(section.section('references'))
    speeds = [
        _number('speeds_m_per_min', value, 0.1, _FASTEST) / MINUTE
        for value in section.list_of('speeds_m_per_min')
    ]
    loads = _named('loads', section.list_of('loads'), masses)
    for load in loads:
        if not minimum <= load.mass * _ROUNDING or not load.mass <= maximum * _ROUNDING:
            raise PlanError(f'loads: {load.name}, {GRAMS * load.mass:g} g, is not in Min..Max')
    count = section.whole('passes', _MOST_PASSES, 0) if section.has('passes') else 0
    rest = section.section('rest') if section.has('rest') else _Section('rest', {})
    zero = section.section('zero') if section.has('zero') else None
    plan = Plan(
        machine=section.texts('machine'),
        load_cell=section.texts('load_cell'),
        amplifier=section.texts('amplifier'),
        accuracy_class=accuracy_class,
        minimum=minimum,
        maximum=maximum,
        prepackages=_prepackages(section, accuracy_class, maximum),
        operator=section.text('operator'),
        place=section.text('place'),
        environment=section.text('environment'),
        masses=tuple(masses.values()),
        passes=tuple(
            Passes(load, speed, count or weighings_required(load.mass))
            for speed in speeds
            for load in loads
        ),
        warm_up=_warm_up(section, masses),
        zero_readings=zero.whole('readings', _MOST_READINGS, 5) if zero else 0,
        outside=_outside(section, masses),
        eccentricity=_eccentricity(section, masses),
        repeatability=_repeatability(section, masses),
        static=_static(section, masses, maximum),
        duration=rest.number('duration_s', 0.2, _MOST_SECONDS, 5.0),
        tolerance=rest.number('tolerance_g', 1e-6, _LARGEST_G, 0.1) / GRAMS,
    )
    rest.finish()
    if zero:
        zero.finish()
    _check_distinct('speeds_m_per_min', [f'{MINUTE * speed:g}' for speed in speeds])
    _check_distinct('loads', [load.name for load in loads])
    return plan


def _accuracy_class(section: _Section) -> AccuracyClass:
    try:
        return AccuracyClass(
            section.text('class'), section.number('factor', 0, 2, 1.0),
            section.number('e_g', 1e-6, _LARGEST_G) / GRAMS, section.flag('in_service'),
        )  # fmt: skip
    except PlanError:
        raise
    except ValueError as error:
        raise PlanError(str(error)) from None


def _check_range(accuracy_class: AccuracyClass, minimum: float, maximum: float) -> None:
    if not 0 < minimum < maximum:
        raise PlanError(f'min_g: {GRAMS * minimum:g} is not above 0 and below max_g')
    try:
        check_range(accuracy_class, minimum, maximum)
    except ValueError as error:
        raise PlanError(f'e_g, min_g, max_g: {error}') from None


def _prepackages(
    section: _Section, accuracy_class: AccuracyClass, maximum: float
) -> tuple[Suitability, ...]:
    key = 'prepackages_g'
    found = []
    for value in section.list_of(key) if section.has(key) else ():
        nominal = _number(key, value, GRAMS * SMALLEST, GRAMS * LARGEST) / GRAMS
        if nominal > maximum * _ROUNDING:
            raise PlanError(f'{key}: {value:g} g is above Max, {GRAMS * maximum:g} g')
        one = suitability(accuracy_class, nominal)
        if not one.suitable:
            raise PlanError(
                f'{key}: {value:g} g may be checked by a scale whose error in service is at most '
                f'{GRAMS * one.allowed_error:.3g} g (FPackV, Annex 7); that of '
                f'{accuracy_class.name} with e = {GRAMS * accuracy_class.interval:g} g is '
                f'{GRAMS * one.max_error:.3g} g'
            )
        found.append(one)
    _check_distinct(key, [f'{GRAMS * one.nominal:g}' for one in found])
    return tuple(found)


def _masses(section: _Section) -> dict[str, Mass]:
    masses = {}
    for name in section.names():
        if not re.fullmatch(r'\w[\w.-]*', name):
            raise PlanError(f'{section.key(name)}: a name is of letters, digits, _, - and .')
        entry = section.section(name)
        masses[name] = Mass(
            name, entry.number('mass_g', 1e-3, _LARGEST_G) / GRAMS,
            entry.number('uncertainty_g', 0, _LARGEST_G) / GRAMS, entry.text('certificate'),
            entry.text('serial'),
        )  # fmt: skip
        entry.finish()
    if not masses:
        raise PlanError('references: names no mass')
    return masses


def _warm_up(section: _Section, masses: Mapping[str, Mass]) -> WarmUp | None:
    if not section.has('warm_up'):
        return None
    own = section.section('warm_up')
    minutes = tuple(
        _number(own.key('minutes'), value, 0, _MOST_MINUTES) for value in own.list_of('minutes')
    )
    if list(minutes) != sorted(set(minutes)):
        raise PlanError(f'{own.key("minutes")}: must go up')
    found = WarmUp(minutes, _passes(own, masses))
    own.finish()
    return found


def _outside(section: _Section, masses: Mapping[str, Mass]) -> tuple[Passes, ...]:
    if not section.has('outside'):
        return ()
    found = []
    for number, entry in enumerate(section.list_of('outside'), start=1):
        own = _Section(f'outside.{number}', entry)
        found.append(_passes(own, masses, 3))
        own.finish()
    return tuple(found)


def _eccentricity(section: _Section, masses: Mapping[str, Mass]) -> Eccentricity | None:
    if not section.has('eccentricity'):
        return None
    own = section.section('eccentricity')
    positions = [str(each) for each in own.list_of('positions')]
    for position in positions:
        if not re.fullmatch(r'\w+', position):
            raise PlanError(f'{own.key("positions")}: {position!r}: a name is of letters')
    _check_distinct(own.key('positions'), positions)
    found = Eccentricity(tuple(positions), _passes(own, masses))
    own.finish()
    return found


def _repeatability(section: _Section, masses: Mapping[str, Mass]) -> Passes | None:
    if not section.has('repeatability'):
        return None
    own = section.section('repeatability')
    found = _passes(own, masses)
    own.finish()
    return found


def _static(
    section: _Section, masses: Mapping[str, Mass], maximum: float
) -> tuple[Mass, ...]:  # fmt: skip
    if not section.has('static'):
        return ()
    own = section.section('static')
    found = _named(own.key('loads'), own.list_of('loads'), masses)
    own.finish()
    for load in found:
        if load.mass > maximum * _ROUNDING:
            raise PlanError(f'static.loads: {load.name}, {GRAMS * load.mass:g} g, is above Max')
    _check_distinct('static.loads', [load.name for load in found])
    return tuple(sorted(found, key=lambda load: load.mass))


def _passes(section: _Section, masses: Mapping[str, Mass], default: int = 0) -> Passes:
    load = _named(section.key('load'), [section.take('load')], masses)[0]
    speed = section.number('speed_m_per_min', 0.1, _FASTEST) / MINUTE
    count = section.whole('passes', _MOST_PASSES, default or weighings_required(load.mass))
    return Passes(load, speed, count)


def _named(key: str, names: list[object], masses: Mapping[str, Mass]) -> list[Mass]:
    for name in names:
        if name not in masses:
            raise PlanError(f'{key}: {name!r} is none of the references {", ".join(masses)}')
    return [masses[str(name)] for name in names]


def _number(key: str, value: object, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise PlanError(f'{key}: {value!r} is not a number')
    if not low <= value <= high or math.isnan(value):
        raise PlanError(f'{key}: {value:g} is not in {low:g}..{high:g}')
    return float(value)


def _check_distinct(key: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise PlanError(f'{key}: {name} is there twice')

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plan of a verification: what is verified, to which class, with which masses, in which tests.

It is one YAML file; `EXAMPLE` is one with a comment at each key. Masses in it are in grams and
speeds in m/min, as the keys say, and become kg and m/s here. A test whose section is left out is
not done, and the report says so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from importlib.resources import files
import re
from typing import Any

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.records import GRAMS
from checkweigher_core.settings_files import Settings, settings_of
from checkweigher_core.yaml_files import opened
from checkweigher_production.prepackages import LARGEST, SMALLEST
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

_ROUNDING = 1 + 1e-9
_MOST_PASSES, _LARGEST_G, _FASTEST = 10_000, 1e7, 600.0  # passes, g, m/min


@dataclass(frozen=True)
class Mass(Settings):
    """A reference mass with its certificate."""

    name: str = parameter(text='by which the plan calls it')
    mass_g: float = parameter(text='mass', unit='g', minimum=1e-3, maximum=_LARGEST_G)
    uncertainty_g: float = parameter(text='standard', unit='g', minimum=0, maximum=_LARGEST_G)
    certificate: str = parameter(text='number of the certificate')
    serial: str = parameter(text='serial number')

    def __post_init__(self) -> None:
        if not re.fullmatch(r'\w[\w.-]*', self.name):
            raise SettingsError('a name is of letters, digits, _, - and .')

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.mass_g / GRAMS

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of the mass, kg."""
        return self.uncertainty_g / GRAMS


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


def _grams(text: str, default: Any = MISSING, minimum: float = 1e-6) -> Any:
    return parameter(default, text, unit='g', minimum=minimum, maximum=_LARGEST_G)


@dataclass(frozen=True)
class _Passes(Settings):
    load: str = parameter(text='reference mass')
    speed_m_per_min: float = parameter(text='belt speed', minimum=0.1, maximum=_FASTEST)
    passes: int = parameter(0, 'number; 0 by the load', minimum=1, maximum=_MOST_PASSES)


@dataclass(frozen=True, kw_only=True)
class _WarmUp(_Passes):
    minutes: tuple[float, ...] = parameter(text='times', minimum=0, maximum=24 * 60)

    def __post_init__(self) -> None:
        if list(self.minutes) != sorted(set(self.minutes)):
            raise SettingsError('must go up', 'minutes')


@dataclass(frozen=True, kw_only=True)
class _Eccentricity(_Passes):
    positions: tuple[str, ...] = parameter(text='names of lanes on the belt')

    def __post_init__(self) -> None:
        for position in self.positions:
            if not re.fullmatch(r'\w+', position):
                raise SettingsError(f'{position!r}: a name is of letters', 'positions')
        _check_distinct(self.positions, 'positions')


@dataclass(frozen=True)
class _Zero(Settings):
    readings: int = parameter(5, 'of the empty belt', minimum=1, maximum=100)


@dataclass(frozen=True)
class _Static(Settings):
    loads: tuple[str, ...] = parameter(text='reference masses')


@dataclass(frozen=True)
class _Rest(Settings):
    duration_s: float = parameter(5.0, 'time of a reading', unit='s', minimum=0.2, maximum=60)
    tolerance_g: float = _grams('by which it may move', 0.1)


@dataclass(frozen=True, kw_only=True)
class PlanFile(Settings):
    """A plan as it is written; `plan` is what it means."""

    machine: Mapping[str, str] = parameter(text='nameplate')
    load_cell: Mapping[str, str] = parameter(text='nameplate')
    amplifier: Mapping[str, str] = parameter(text='nameplate')
    class_: str = parameter(text='accuracy class')
    factor: float = parameter(1.0, 'class factor x', minimum=0, maximum=2)
    in_service: bool = parameter(False, 'whether limits in service hold')
    e_g: float = _grams('verification scale interval')
    min_g: float = _grams('Min', minimum=0)
    max_g: float = _grams('Max', minimum=0)
    prepackages_g: tuple[float, ...] = parameter(
        (), 'nominal quantities', minimum=GRAMS * SMALLEST, maximum=GRAMS * LARGEST
    )
    operator: str = parameter(text='who does it')
    place: str = parameter(text='where')
    environment: str = parameter(text='temperature, humidity, pressure')
    references: Mapping[str, Mass] = parameter(text='known masses')
    speeds_m_per_min: tuple[float, ...] = parameter(text='speeds', minimum=0.1, maximum=_FASTEST)
    loads: tuple[str, ...] = parameter(text='masses that pass at each speed')
    passes: int = parameter(0, 'number; 0 by the load', minimum=1, maximum=_MOST_PASSES)
    warm_up: _WarmUp | None = parameter(None, 'passes after switching on')
    zero: _Zero | None = parameter(None, 'readings of the zero')
    outside: tuple[_Passes, ...] = parameter((), 'passes beyond the range')
    eccentricity: _Eccentricity | None = parameter(None, 'passes beside the middle')
    repeatability: _Passes | None = parameter(None, 'passes of one load')
    static: _Static | None = parameter(None, 'loads at rest')
    rest: _Rest = parameter(_Rest(), 'reading at rest')

    def plan(self) -> Plan:
        """Return the plan; `SettingsError` if its values do not fit together."""
        minimum, maximum = self.min_g / GRAMS, self.max_g / GRAMS
        accuracy_class = self._accuracy_class(minimum, maximum)
        _check_distinct([f'{each:g}' for each in self.speeds_m_per_min], 'speeds_m_per_min')
        loads = self._loads(self.loads, 'loads')
        for load in loads:
            if not minimum <= load.mass * _ROUNDING or not load.mass <= maximum * _ROUNDING:
                raise SettingsError(f'{load.name}, {load.mass_g:g} g, is not in Min..Max', 'loads')
        static = self._loads(self.static.loads, 'static', 'loads') if self.static else []
        for load in static:
            if load.mass > maximum * _ROUNDING:
                text = f'{load.name}, {load.mass_g:g} g, is above Max'
                raise SettingsError(text, 'static', 'loads')
        warm_up, aside, same = self.warm_up, self.eccentricity, self.repeatability
        return Plan(
            self.machine, self.load_cell, self.amplifier, accuracy_class, minimum, maximum,
            self._prepackages(accuracy_class, maximum), self.operator, self.place,
            self.environment, tuple(self.references.values()),
            passes=tuple(
                Passes(load, speed / MINUTE, self.passes or weighings_required(load.mass))
                for speed in self.speeds_m_per_min
                for load in loads
            ),
            warm_up=WarmUp(warm_up.minutes, self._passes(warm_up, 'warm_up')) if warm_up else None,
            zero_readings=self.zero.readings if self.zero else 0,
            outside=tuple(
                self._passes(each, 'outside', number, default=3)
                for number, each in enumerate(self.outside, 1)
            ),
            eccentricity=Eccentricity(aside.positions, self._passes(aside, 'eccentricity'))
            if aside
            else None,
            repeatability=self._passes(same, 'repeatability') if same else None,
            static=tuple(sorted(static, key=lambda load: load.mass)),
            duration=self.rest.duration_s,
            tolerance=self.rest.tolerance_g / GRAMS,
        )  # fmt: skip

    def _accuracy_class(self, minimum: float, maximum: float) -> AccuracyClass:
        if not 0 < minimum < maximum:
            raise SettingsError(f'{self.min_g:g} is not above 0 and below max_g', 'min_g')
        try:
            made = AccuracyClass(self.class_, self.factor, self.e_g / GRAMS, self.in_service)
        except ValueError as error:
            raise SettingsError(
                str(error), 'factor' if 'factor' in str(error) else 'class'
            ) from None
        try:
            check_range(made, minimum, maximum)
        except ValueError as error:
            raise SettingsError(f'with min_g and max_g: {error}', 'e_g') from None
        return made

    def _prepackages(self, scale: AccuracyClass, maximum: float) -> tuple[Suitability, ...]:
        key = 'prepackages_g'
        _check_distinct([f'{each:g}' for each in self.prepackages_g], key)
        found = []
        for value in self.prepackages_g:
            if value / GRAMS > maximum * _ROUNDING:
                raise SettingsError(f'{value:g} g is above Max, {GRAMS * maximum:g} g', key)
            one = suitability(scale, value / GRAMS)
            if not one.suitable:
                raise SettingsError(
                    f'{value:g} g may be checked by a scale whose error in service is at most '
                    f'{GRAMS * one.allowed_error:.3g} g (FPackV, Annex 7); that of '
                    f'{scale.name} with e = {GRAMS * scale.interval:g} g is '
                    f'{GRAMS * one.max_error:.3g} g', key
                )  # fmt: skip
            found.append(one)
        return tuple(found)

    def _passes(self, given: _Passes, *path: object, default: int = 0) -> Passes:
        (load,) = self._loads([given.load], *path, 'load')
        count = given.passes or default or weighings_required(load.mass)
        return Passes(load, given.speed_m_per_min / MINUTE, count)

    def _loads(self, names: Sequence[str], *path: object) -> list[Mass]:
        for name in names:
            if name not in self.references:
                text = f'{name!r} is none of the references {", ".join(self.references)}'
                raise SettingsError(text, *path)
        _check_distinct(names, *path)
        return [self.references[name] for name in names]


def read_plan(text: str) -> Plan:
    """Return the plan of a YAML text; `SettingsError` names the first key that cannot be used."""
    if len(text) > LONGEST:
        raise SettingsError(f'{len(text)} characters, at most {LONGEST}: shorten the comments')
    with opened(text) as content:
        return settings_of(PlanFile, content).plan()


def _check_distinct(names: Sequence[str], *path: object) -> None:
    for name in names:
        if names.count(name) > 1:
            raise SettingsError(f'{name} is there twice', *path)

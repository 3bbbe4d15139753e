# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Plan of a verification: a YAML file with machine, accuracy class, reference masses and tests.

`EXAMPLE` is a plan with a comment for each key. Masses are in g, and speeds are in m/min. A test
without a section in the plan is not made. The report mentions each missing test except the warm-up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from importlib.resources import files
import re
from typing import Any, NamedTuple

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
LONGEST = 10_000  # largest number of characters of a plan
MINUTE = 60.0  # seconds in a minute
PLANS, VERIFICATIONS = 'plans', 'verifications'  # names of subfolders of the machine folder.

# Factor by which a mass may exceed a limit, so that rounding errors do not exclude an equal mass.
_ROUNDING = 1 + 1e-9
# Largest number of passes, largest mass in g, and largest belt speed in m/min.
_MOST_PASSES, _LARGEST_G, _FASTEST = 10_000, 1e7, 600.0


def _grams(text: str, default: Any = MISSING, minimum: float = 1e-6) -> Any:
    return parameter(default, text, unit='g', minimum=minimum, maximum=_LARGEST_G)


@dataclass(frozen=True)
class Mass(Settings):
    """A reference mass with its certificate."""

    name: str = parameter(text='name in the plan')
    mass_g: float = parameter(text='mass', unit='g', minimum=1e-3, maximum=_LARGEST_G)
    uncertainty_g: float = parameter(
        text='standard uncertainty', unit='g', minimum=0, maximum=_LARGEST_G
    )
    certificate: str = parameter(text='number of the certificate')
    serial: str = parameter(text='serial number')

    def __post_init__(self) -> None:
        if not re.fullmatch(r'\w[\w.-]*', self.name):
            raise SettingsError(
                'a name may contain only letters, digits, _, - and dots, and must not begin with - '
                'or a dot'
            )

    @property
    def mass(self) -> float:
        """Mass in kg."""
        return self.mass_g / GRAMS

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of the mass in kg."""
        return self.uncertainty_g / GRAMS


class Passes(NamedTuple):
    """Passes of one load at one belt speed."""

    load: Mass
    speed: float  # m/s
    passes: int


@dataclass(frozen=True)
class PassesOfLoad(Settings):
    """Section of a plan with the passes of one load at one belt speed."""

    load: str = parameter(text='name of the reference mass')
    speed_m_per_min: float = parameter(text='belt speed in m/min', minimum=0.1, maximum=_FASTEST)
    passes: int = parameter(
        0, 'number of passes; 0 selects the required number', minimum=1, maximum=_MOST_PASSES
    )


@dataclass(frozen=True, kw_only=True)
class WarmUp(PassesOfLoad):
    """Section of a plan with the times at which zero and passes are recorded in a warm-up."""

    minutes: tuple[float, ...] = parameter(
        text='ascending times after the first step in min', minimum=0, maximum=24 * 60
    )

    def __post_init__(self) -> None:
        if list(self.minutes) != sorted(set(self.minutes)):
            raise SettingsError('must be ascending', 'minutes')


@dataclass(frozen=True, kw_only=True)
class Eccentricity(PassesOfLoad):
    """Section of a plan with the passes of one load at several positions across the belt."""

    positions: tuple[str, ...] = parameter(text='names of positions across the belt')

    def __post_init__(self) -> None:
        for position in self.positions:
            if not re.fullmatch(r'\w+', position):
                raise SettingsError(
                    f'{position!r}: a name may contain only letters, digits and _', 'positions'
                )
        _check_distinct(self.positions, 'positions')


@dataclass(frozen=True)
class ZeroReadings(Settings):
    """Section of a plan with the number of readings of the zero."""

    readings: int = parameter(5, 'number of readings of the empty belt', minimum=1, maximum=100)


@dataclass(frozen=True)
class Static(Settings):
    """Section of a plan with the loads at rest."""

    loads: tuple[str, ...] = parameter(text='names of the reference masses')


@dataclass(frozen=True)
class Rest(Settings):
    """Section of a plan with the settings of a reading at rest."""

    duration_s: float = parameter(5.0, 'duration of a reading', unit='s', minimum=0.2, maximum=60)
    tolerance_g: float = _grams('largest drift of a reading', 0.1)

    @property
    def tolerance(self) -> float:
        """Largest drift of a reading in kg."""
        return self.tolerance_g / GRAMS


@dataclass(frozen=True, kw_only=True)
class Plan(Settings):
    """Plan of a verification.

    The fields have the units in their names, and the properties have SI units. The field of a test
    is None or empty if the test is not made. Raises `SettingsError` if the class does not allow e,
    Min and Max, if a load is unknown or outside the weighing range, if a value is listed twice, or
    if the class is not suitable for one of the prepackages.
    """

    machine: Mapping[str, str] = parameter(text='nameplate of the machine')
    load_cell: Mapping[str, str] = parameter(text='nameplate of the load cell')
    amplifier: Mapping[str, str] = parameter(text='nameplate of the amplifier')
    class_: str = parameter(text='accuracy class')
    factor: float = parameter(1.0, 'class factor x', minimum=0, maximum=2)
    in_service: bool = parameter(False, 'whether the limits in service apply')
    e_g: float = _grams('verification scale interval')
    min_g: float = _grams('smallest load Min', minimum=0)
    max_g: float = _grams('largest load Max', minimum=0)
    prepackages_g: tuple[float, ...] = parameter(
        (), 'nominal quantities in g', minimum=GRAMS * SMALLEST, maximum=GRAMS * LARGEST
    )
    operator: str = parameter(text='name of the operator')
    place: str = parameter(text='place of the verification')
    environment: str = parameter(text='temperature, relative humidity and air pressure')
    references: Mapping[str, Mass] = parameter(text='reference masses by name')
    speeds_m_per_min: tuple[float, ...] = parameter(
        text='belt speeds in m/min', minimum=0.1, maximum=_FASTEST
    )
    loads: tuple[str, ...] = parameter(text='reference masses that pass at each speed')
    passes: int = parameter(
        0, 'number of passes; 0 selects the required number', minimum=1, maximum=_MOST_PASSES
    )
    warm_up: WarmUp | None = parameter(None, 'zero and passes after switching on')
    zero: ZeroReadings | None = parameter(None, 'readings of the zero')
    outside: tuple[PassesOfLoad, ...] = parameter((), 'passes outside the range of dynamic setting')
    eccentricity: Eccentricity | None = parameter(None, 'passes beside the middle of the belt')
    repeatability: PassesOfLoad | None = parameter(None, 'repeated passes of one load')
    static: Static | None = parameter(None, 'readings of loads at rest')
    rest: Rest = parameter(Rest(), 'settings of the readings at rest')

    def __post_init__(self) -> None:
        self._check_class()
        _check_distinct([f'{each:g}' for each in self.speeds_m_per_min], 'speeds_m_per_min')
        for load in self._known(self.loads, 'loads'):
            if not self.min_g <= load.mass_g * _ROUNDING or load.mass_g > self.max_g * _ROUNDING:
                text = f'{load.name}, {load.mass_g:g} g, is not between Min and Max'
                raise SettingsError(text, 'loads')
        for load in self._known(self.static.loads if self.static else (), 'static', 'loads'):
            if load.mass_g > self.max_g * _ROUNDING:
                text = f'{load.name}, {load.mass_g:g} g, is above Max'
                raise SettingsError(text, 'static', 'loads')
        self._check_prepackages()
        self._check_sections()

    @property
    def accuracy_class(self) -> AccuracyClass:
        """Accuracy class that the machine must satisfy."""
        return AccuracyClass(self.class_, self.factor, self.e_g / GRAMS, self.in_service)

    @property
    def minimum(self) -> float:
        """Min in kg."""
        return self.min_g / GRAMS

    @property
    def maximum(self) -> float:
        """Max in kg."""
        return self.max_g / GRAMS

    @property
    def prepackages(self) -> tuple[Suitability, ...]:
        """Comparisons of the error of the class with the error allowed at each nominal quantity."""
        return tuple(suitability(self.accuracy_class, each / GRAMS) for each in self.prepackages_g)

    @property
    def passes_in_motion(self) -> tuple[Passes, ...]:
        """Passes of each load at each speed."""
        return tuple(
            self.passes_of(PassesOfLoad(load, speed, self.passes))
            for speed in self.speeds_m_per_min
            for load in self.loads
        )

    @property
    def static_loads(self) -> tuple[Mass, ...]:
        """Loads at rest in ascending order of mass, empty without a test of loads at rest."""
        loads = [self.references[name] for name in self.static.loads] if self.static else []
        return tuple(sorted(loads, key=lambda load: load.mass))

    def passes_of(self, section: PassesOfLoad, default: int = 0) -> Passes:
        """Return the passes of a section.

        If the section has no number of passes, `default` passes are made, or the number that the
        load requires if `default` is 0.
        """
        load = self.references[section.load]
        count = section.passes or default or weighings_required(load.mass)
        return Passes(load, section.speed_m_per_min / MINUTE, count)

    def _check_class(self) -> None:
        if not 0 < self.min_g < self.max_g:
            raise SettingsError(f'{self.min_g:g} must be above 0 and below max_g', 'min_g')
        try:
            own = self.accuracy_class
        except ValueError as error:
            key = 'factor' if 'factor' in str(error) else 'class'
            raise SettingsError(str(error), key) from None
        try:
            check_range(own, self.minimum, self.maximum)
        except ValueError as error:
            raise SettingsError(f'with min_g and max_g: {error}', 'e_g') from None

    def _check_sections(self) -> None:
        for key in ('warm_up', 'eccentricity', 'repeatability'):
            if section := getattr(self, key):
                self._known([section.load], key, 'load')
        for number, section in enumerate(self.outside, 1):
            self._known([section.load], 'outside', number, 'load')

    def _check_prepackages(self) -> None:
        key = 'prepackages_g'
        _check_distinct([f'{each:g}' for each in self.prepackages_g], key)
        for value, one in zip(self.prepackages_g, self.prepackages, strict=True):
            if value > self.max_g * _ROUNDING:
                raise SettingsError(f'{value:g} g is above Max, {self.max_g:g} g', key)
            if not one.suitable:
                text = (
                    f'{value:g} g may be checked by a scale whose error in service is at most '
                    f'{GRAMS * one.allowed_error:.3g} g (FPackV, Annex 7); that of '
                    f'{self.accuracy_class.name} with e = {self.e_g:g} g is '
                    f'{GRAMS * one.max_error:.3g} g'
                )
                raise SettingsError(text, key)

    def _known(self, names: Sequence[str], *path: object) -> list[Mass]:
        """Return the reference masses with the given names.

        Raises `SettingsError` if a name is unknown or is listed twice.
        """
        for name in names:
            if name not in self.references:
                text = f'{name!r} is not one of the references {", ".join(self.references)}'
                raise SettingsError(text, *path)
        _check_distinct(names, *path)
        return [self.references[name] for name in names]


def read_plan(text: str) -> Plan:
    """Return the plan in a YAML text.

    Raises `SettingsError` if the text is not a valid plan or has more than `LONGEST` characters.
    """
    if len(text) > LONGEST:
        raise SettingsError(f'{len(text)} characters are too many; at most {LONGEST} are allowed')
    with opened(text) as content:
        return settings_of(Plan, content)


def _check_distinct(names: Sequence[str], *path: object) -> None:
    for name in names:
        if names.count(name) > 1:
            raise SettingsError(f'{name} is listed twice', *path)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accuracy classes of checkweighers, OIML R 51-1:2006 and GB/T 27739-2011.

Category X contains checkweighers for prepackages. The classes XI, XII, XIII and XIIII limit the
mean error in units of the verification scale interval e, and the class factor x scales the limit of
the standard deviation. Category Y contains all other catchweighers. The classes Y(I), Y(II), Y(a)
and Y(b) limit the error of each weighing. Table 2 of the paper (Long et al.) lists the limits of
XIII(1) with e = 0.1 g at initial verification. GB/T 27739 writes XIV for XIIII. Min and Max are the
smallest and the largest load that a machine may weigh.

The classes, class factors (4.2), values of e, and maximum permissible errors of both categories at
initial verification are from Directive 2014/32/EU (MID), Annex VIII, Chapter II, and UK SI
2016/1153, Schedule 1G. Chapter II, Table 1, "Static", of UK SI 2016/1153 lists the maximum
permissible errors of category Y at rest. The maximum permissible errors of category Y at rest in
service are from NI SR 2006/154, Schedule 5, Table 2. The smallest Min of Y(a) and Y(b) is from UK
SI 2003/2761, Schedule 1. The rule on the prepackages that a class may check is from the German
FPackV of 2020, Annex 7, 1 b. The table of the largest e in FPackV is not used. Two sets of limits
are quoted from memory and were not compared with the text of R 51: the maximum permissible errors
of category Y for weighing in motion in service, and the maximum permissible standard deviations for
loads above 300 g.

Nothing here is type-approved for legal metrology. A result applies to a simulation or a test run,
and is no evidence that a machine conforms to Directive 2014/32/EU.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
import math

from checkweigher_core.records import GRAMS
from checkweigher_production.prepackages import tolerable_negative_error
from checkweigher_validation.accuracy.errors import ConditionResult

# Factor by which bounds are widened, so that a value that equals a bound is accepted in spite of
# rounding errors.
_ON_BOUND = 1 + 1e-9

# Upper limits of the three load ranges of each class, in verification scale intervals e.
_STEPS = {
    'XI': (50_000.0, 200_000.0, math.inf),
    'XII': (5_000.0, 20_000.0, 100_000.0),
    'XIII': (500.0, 2_000.0, 10_000.0),
    'XIIII': (50.0, 200.0, 1_000.0),
}
_LIKE = {'Y(I)': 'XI', 'Y(II)': 'XII', 'Y(a)': 'XIII', 'Y(b)': 'XIIII'}
CLASSES = (*_STEPS, *_LIKE)

# Largest error in e for each of the three ranges of load. A key consists of the category, and of
# True for the limits in service or False for the limits at initial verification. The values of
# category X also apply to loads at rest in category Y.
_ERRORS = {
    ('X', False): (0.5, 1.0, 1.5),
    ('X', True): (1.0, 2.0, 3.0),
    ('Y', False): (1.0, 1.5, 2.0),
    ('Y', True): (1.5, 2.5, 3.5),
}

# Each row has the smallest and the largest e in kg, and the smallest and the largest Max in e.
_INTERVALS = {
    'XI': ((1e-6, math.inf, 50_000, math.inf),),
    'XII': ((1e-6, 0.05e-3, 100, 100_000), (0.1e-3, math.inf, 5_000, 100_000)),
    'XIII': ((0.1e-3, 2e-3, 100, 10_000), (5e-3, math.inf, 500, 10_000)),
    'XIIII': ((5e-3, math.inf, 100, 1_000),),
}

# Rule for the class factor of each class (4.2 of the MID). By R 51, no class factor is above 2.
_FACTORS: dict[str, tuple[str, Callable[[float], bool]]] = {
    'XI': ('below 1', lambda x: x < 1),
    'XII': ('below 1', lambda x: x < 1),
    'XIII': ('at most 1', lambda x: x <= 1),
    'XIIII': ('above 1', lambda x: x > 1),
}

_LEAST_MINIMUM = {'Y(a)': 20, 'Y(b)': 10}  # smallest Min in e.

# Each row has the largest load in kg, and the limits of the standard deviation for x = 1 at initial
# verification and in service. The limits are relative to the load (_SHARE) or in kg (_CONSTANT).
_SHARE, _CONSTANT = True, False
_STD_DEV_ROWS = (
    (0.05, _SHARE, 0.48e-2, 0.6e-2),
    (0.1, _CONSTANT, 0.24e-3, 0.3e-3),
    (0.2, _SHARE, 0.24e-2, 0.3e-2),
    (0.3, _CONSTANT, 0.48e-3, 0.6e-3),
    # The following rows are quoted from memory and were not compared with the standard.
    (0.5, _SHARE, 0.16e-2, 0.2e-2),
    (1.0, _CONSTANT, 0.8e-3, 1.0e-3),
    (10.0, _SHARE, 0.08e-2, 0.1e-2),
    (15.0, _CONSTANT, 8e-3, 10e-3),
    (math.inf, _SHARE, 0.053e-2, 0.067e-2),
)

_SUITABLE_SHARE = 1 / 5  # largest error in service relative to the tolerable negative error.

# Each row has the largest load in kg, and the number of weighings that a verification requires.
_WEIGHINGS = ((1.0, 60), (10.0, 30), (20.0, 20), (math.inf, 10))


@dataclass(frozen=True, slots=True)
class AccuracyClass:
    """Accuracy class of a checkweigher, with the limits at initial verification or in service.

    Raises `ValueError` if the class is unknown, the class factor is not allowed for it, or e is not
    positive.
    """

    name: str = 'XIII'  # one of CLASSES, or XIV for XIIII.
    # Class factor x, which is 1, 2 or 5 times 10^k in category X, and 1 in category Y. The class
    # factor is below 1 for XI and XII, at most 1 for XIII, and above 1 and at most 2 for XIIII.
    factor: float = 1.0
    interval: float = 0.1e-3  # verification scale interval e in kg
    in_service: bool = False  # True for the limits in service, False for initial verification

    def __post_init__(self) -> None:
        object.__setattr__(self, 'name', _class_name(self.name))
        _check_positive(self.factor, 'class factor x')
        if not (_is_round(self.factor) and self.factor <= 2):
            raise ValueError(f'class factor x: {self.factor:g} is not 1, 2 or 5 x 10^k up to 2')
        if self.category == 'Y' and self.factor != 1:
            raise ValueError(f'class factor x: {self.name} has none; only category X has one')
        if self.category == 'X':
            words, allowed = _FACTORS[self.name]
            if not allowed(self.factor):
                raise ValueError(f'class factor x of {self.name}: {self.factor:g} is not {words}')
        _check_positive(self.interval, 'verification scale interval e')

    @property
    def category(self) -> str:
        """Category X (prepackages) or Y (all other catchweighers)."""
        return self.name[0]

    def __str__(self) -> str:
        name = f'{self.name}({self.factor:g})' if self.category == 'X' else self.name
        occasion = 'in service' if self.in_service else 'initial verification'
        return f'{name}, e = {1000 * self.interval:g} g, {occasion}'

    def max_error(self, mass: float) -> float:
        """Return the limit of the magnitude of the error at a load, in kg.

        In category X, this is the limit of the mean error. In category Y, this is the limit of each
        error. Returns NaN for a load above the range of the class.
        """
        return self._step_of_error(mass, self.category)

    def max_static_error(self, mass: float) -> float:
        """Return the limit of the magnitude of the error of a load at rest, in kg.

        The limit of the mean error in category X applies to loads at rest in both categories.
        Returns NaN for a load above the range of the class.
        """
        return self._step_of_error(mass, 'X')

    def _step_of_error(self, mass: float, category: str) -> float:
        loads = _STEPS[_LIKE.get(self.name, self.name)]
        steps = zip(loads, _ERRORS[category, self.in_service], strict=True)
        found = (error for load, error in steps if mass <= load * self.interval * _ON_BOUND)
        return next(found, math.nan) * self.interval

    def max_std_dev(self, mass: float) -> float:
        """Return the limit of the standard deviation of the error at a load, in kg.

        Returns infinity in category Y, which has no such limit. The limits of loads above 0.3 kg
        are quoted from memory and were not compared with the text of the standard.
        """
        if self.category == 'Y':
            return math.inf
        _, kind, initial, service = next(row for row in _STD_DEV_ROWS if mass <= row[0] * _ON_BOUND)
        limit = service if self.in_service else initial
        return self.factor * limit * (mass if kind is _SHARE else 1.0)


def _class_name(name: str) -> str:
    """Return the name of a class in R 51, which is XIIII for XIV.

    Raises `ValueError` if the class is unknown.
    """
    name = 'XIIII' if name == 'XIV' else name
    if name not in CLASSES:
        raise ValueError(f'class {name!r} is not one of {", ".join(CLASSES)}')
    return name


def smallest_interval(name: str, maximum: float) -> float:
    """Return the smallest verification scale interval e in kg that a class allows for a Max in kg.

    The interval is 1, 2 or 5 times 10^k kg. Raises `ValueError` if the class is unknown, if Max is
    not positive, or if the class allows no e for this Max.

    References
    ----------
    Directive 2014/32/EU, Annex VIII, Chapter II, 5, Table 3.

    Examples
    --------
    >>> smallest_interval('XIII', 6.0)  # Max is 6000 e, and would be above 10,000 e with 0.5 g
    0.001
    """
    name = _class_name(name)
    _check_positive(maximum, 'Max')
    exponents = range(-6, math.ceil(math.log10(maximum)) + 1)
    for exponent, digit in product(exponents, (1, 2, 5)):
        interval = float(f'{digit}e{exponent}')
        fewest, most = _interval_counts(name, interval)
        if fewest / _ON_BOUND <= maximum / interval <= most * _ON_BOUND:
            return interval
    raise ValueError(f'class {name} has no verification scale interval for Max {maximum:g} kg')


def _interval_counts(name: str, interval: float) -> tuple[float, float]:
    """Return the smallest and the largest Max in e that a class allows with e = `interval` in kg.

    Returns (inf, -inf) if the class does not allow this e.
    """
    for low, high, fewest, most in _INTERVALS[_LIKE.get(name, name)]:
        if low <= interval * _ON_BOUND and interval <= high * _ON_BOUND:
            return fewest, most
    return math.inf, -math.inf


def check_range(accuracy_class: AccuracyClass, minimum: float, maximum: float) -> None:
    """Check that a class allows its e for the weighing range from Min to Max, in kg.

    Min is checked only for Y(a) and Y(b), because the smallest Min of other classes is not known.

    Raises `ValueError` with the violated rule if the range is not allowed.

    References
    ----------
    Directive 2014/32/EU, Annex VIII, Chapter II, 5, Table 3, for e and Max; UK SI 2003/2761,
    Schedule 1, for Min.
    """
    name, interval = accuracy_class.name, accuracy_class.interval
    e = GRAMS * interval
    if not _is_round(interval):
        raise ValueError(f'e: {e:g} g is not 1, 2 or 5 x 10^k')
    smallest = smallest_interval(name, maximum)
    if interval * _ON_BOUND < smallest:
        raise ValueError(
            f'e: {e:g} g is below {GRAMS * smallest:g} g, the smallest of class {name} for a Max '
            f'of {GRAMS * maximum:g} g'
        )
    fewest, _ = _interval_counts(name, interval)
    if maximum / interval * _ON_BOUND < fewest:
        raise ValueError(
            f'e: {e:g} g gives {maximum / interval:g} intervals for a Max of {GRAMS * maximum:g} '
            f'g, but class {name} needs at least {fewest:g}'
        )
    least = _LEAST_MINIMUM.get(name, 0) * interval
    if minimum * _ON_BOUND < least:
        raise ValueError(
            f'Min: {GRAMS * minimum:g} g is below {GRAMS * least:g} g, the smallest of class '
            f'{name}: {_LEAST_MINIMUM[name]} e'
        )


@dataclass(frozen=True, slots=True)
class Suitability:
    """Comparison of the error of a class with the error allowed for prepackages, in kg."""

    nominal: float  # nominal quantity of the prepackages
    tolerable_negative_error: float
    max_error: float  # maximum error of the class in service at `nominal`, NaN above its range

    @property
    def allowed_error(self) -> float:
        """Largest error in service, in kg, of a scale that may check the prepackages."""
        return _SUITABLE_SHARE * self.tolerable_negative_error

    @property
    def suitable(self) -> bool:
        """Whether a scale of the class may check the prepackages. False above its range."""
        return self.max_error <= self.allowed_error * _ON_BOUND


def suitability(accuracy_class: AccuracyClass, nominal: float) -> Suitability:
    """Compare the error of a class with a fifth of the tolerable negative error of prepackages.

    The limits in service are used, even if `accuracy_class` is for initial verification. `nominal`
    is the nominal quantity in kg. Raises `ValueError` if 76/211/EEC has no limits for this
    quantity.

    References
    ----------
    FPackV of 18 November 2020 (BGBl. I 2020, 2504), Annex 7, 1 b.
    """
    in_service = replace(accuracy_class, in_service=True)
    return Suitability(nominal, tolerable_negative_error(nominal), in_service.max_error(nominal))


def weighings_required(mass: float) -> int:
    """Return the number of weighings of a load in kg that a verification requires."""
    return next(count for bound, count in _WEIGHINGS if mass <= bound * _ON_BOUND)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Result of the comparison of the errors at a load with the limits of a class."""

    max_error: float  # limit in kg as in `AccuracyClass.max_error`
    max_std_dev: float  # limit in kg as in `AccuracyClass.max_std_dev`
    error_passed: bool  # whether the error is at most `max_error`; False if one of them is NaN.
    # Whether the standard deviation is at most `max_std_dev`. Always True in category Y.
    std_dev_passed: bool
    weighings: int  # number of weighed passes
    weighings_required: int  # number that a verification requires at this load

    @property
    def enough_weighings(self) -> bool:
        """Whether there are at least as many weighings as a verification requires."""
        return self.weighings >= self.weighings_required

    @property
    def passed(self) -> bool:
        """Whether there are enough weighings, and both limits are met."""
        return self.error_passed and self.std_dev_passed and self.enough_weighings


def judge(condition: ConditionResult, accuracy_class: AccuracyClass) -> Judgement:
    """Compare the errors at a condition with the limits of a class.

    In category X, the mean error and the standard deviation are compared. In category Y, the error
    with the largest magnitude is compared.
    """
    limit = accuracy_class.max_error(condition.mass)
    std_dev_limit = accuracy_class.max_std_dev(condition.mass)
    error = abs(condition.mean_error)
    if accuracy_class.category == 'Y':
        error = max(abs(condition.errors), default=math.nan)
    return Judgement(
        max_error=limit,
        max_std_dev=std_dev_limit,
        # A comparison with NaN is False, so an unknown error does not pass.
        error_passed=bool(error <= limit),
        std_dev_passed=math.isinf(std_dev_limit) or condition.std_dev <= std_dev_limit,
        weighings=condition.count,
        weighings_required=weighings_required(condition.mass),
    )


def _is_round(value: float) -> bool:
    return f'{value:.9e}'.split('e')[0].rstrip('0').rstrip('.') in ('1', '2', '5')


def _check_positive(value: float, name: str) -> None:
    if not 0 < value < math.inf:
        raise ValueError(f'{name}: {value:g} is not a positive number')

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accuracy classes of checkweighers: OIML R 51-1:2006, category X, and GB/T 27739-2011.

A class XI, XII, XIII or XIV bounds the mean error in verification scale intervals e, its class
factor x scales the bound of the standard deviation. The limits of Long et al. (their Table 2) are
those of XIII(1) with e = 0.1 g at initial verification.

Nothing here is type-approved for legal metrology: a verdict is of a simulation or a test run
and does not say that a machine conforms. The rows of the standard deviation above 300 g are
quoted from memory and not checked against the standard's text.
"""

from dataclasses import dataclass
import math

from checkweigher_validation.accuracy.errors import ConditionResult

# A mass that lies on a bound must not exceed it by a rounding error.
_ON_BOUND = 1 + 1e-9

# Loads in e up to which the mean error may be 0.5 e, 1 e and 1.5 e at initial verification.
_MEAN_ERROR_STEPS = {
    'XI': (50_000.0, 200_000.0, math.inf),
    'XII': (5_000.0, 20_000.0, 100_000.0),
    'XIII': (500.0, 2_000.0, 10_000.0),
    'XIV': (50.0, 200.0, 1_000.0),
}
CLASSES = tuple(_MEAN_ERROR_STEPS)

# Load in kg up to which a row holds; limit at initial verification and in service, for x = 1:
# a share of the load, or kg.
_SHARE, _CONSTANT = True, False
_STD_DEV_ROWS = (
    (0.05, _SHARE, 0.48e-2, 0.6e-2),
    (0.1, _CONSTANT, 0.24e-3, 0.3e-3),
    (0.2, _SHARE, 0.24e-2, 0.3e-2),
    (0.3, _CONSTANT, 0.48e-3, 0.6e-3),
    # From here on quoted from memory, not checked against the standard's text.
    (0.5, _SHARE, 0.16e-2, 0.2e-2),
    (1.0, _CONSTANT, 0.8e-3, 1.0e-3),
    (10.0, _SHARE, 0.08e-2, 0.1e-2),
    (15.0, _CONSTANT, 8e-3, 10e-3),
    (math.inf, _SHARE, 0.053e-2, 0.067e-2),
)

# Load in kg up to which so many weighings are the least.
_WEIGHINGS = ((1.0, 60), (10.0, 30), (20.0, 20), (math.inf, 10))


@dataclass(frozen=True, slots=True)
class AccuracyClass:
    """A class as it stands on a nameplate, and the occasion.

    Raises
    ------
    ValueError
        If there is no such class, or a number is not positive.
    """

    name: str = 'XIII'  # XI, XII, XIII or XIV
    factor: float = 1.0  # class factor x
    interval: float = 0.1e-3  # verification scale interval e, kg
    in_service: bool = False  # whether these limits hold instead of those at initial verification

    def __post_init__(self) -> None:
        if self.name not in _MEAN_ERROR_STEPS:
            raise ValueError(f'class {self.name!r} is none of {", ".join(CLASSES)}')
        _check_positive(self.factor, 'class factor x')
        _check_positive(self.interval, 'verification scale interval e')

    def __str__(self) -> str:
        occasion = 'in service' if self.in_service else 'initial verification'
        return f'{self.name}({self.factor:g}), e = {1000 * self.interval:g} g, {occasion}'

    def max_mean_error(self, mass: float) -> float:
        """Return the largest magnitude of the mean error at a load, kg.

        NaN for a load above the range of the class; ValueError for one that is not positive.
        """
        _check_positive(mass, 'mass')
        for bound, steps in zip(_MEAN_ERROR_STEPS[self.name], (0.5, 1.0, 1.5), strict=True):
            if mass <= bound * self.interval * _ON_BOUND:
                return steps * self.interval * (2 if self.in_service else 1)
        return math.nan

    def max_std_dev(self, mass: float) -> float:
        """Return the largest standard deviation of the error at a load, kg.

        That of a load above 0.3 kg is quoted from memory and not checked against the standard's
        text. ValueError for a load that is not positive.
        """
        _check_positive(mass, 'mass')
        _, kind, initial, service = next(row for row in _STD_DEV_ROWS if mass <= row[0] * _ON_BOUND)
        limit = service if self.in_service else initial
        return self.factor * limit * (mass if kind is _SHARE else 1.0)


def weighings_required(mass: float) -> int:
    """Return how many weighings of a load in kg a verification takes at least."""
    _check_positive(mass, 'mass')
    return next(count for bound, count in _WEIGHINGS if mass <= bound * _ON_BOUND)


@dataclass(frozen=True, slots=True)
class Judgement:
    """A condition against its limits in kg, and the weighings that the rule asks for.

    `max_mean_error` is NaN for a load above the range of the class. A limit is not kept if there is
    no limit or no value.
    """

    max_mean_error: float
    max_std_dev: float
    mean_error_passed: bool
    std_dev_passed: bool
    weighings: int
    weighings_required: int

    @property
    def enough_weighings(self) -> bool:
        """Whether there are as many weighings as the rule asks for."""
        return self.weighings >= self.weighings_required

    @property
    def within_limits(self) -> bool:
        """Whether both limits are kept, by however many weighings."""
        return self.mean_error_passed and self.std_dev_passed

    @property
    def passed(self) -> bool:
        """Whether both limits are kept by enough weighings."""
        return self.within_limits and self.enough_weighings


def judge(condition: ConditionResult, accuracy_class: AccuracyClass) -> Judgement:
    """Hold a condition to the limits of a class; a pass that got no mass is no weighing."""
    mean_limit = accuracy_class.max_mean_error(condition.mass)
    std_dev_limit = accuracy_class.max_std_dev(condition.mass)
    return Judgement(
        max_mean_error=mean_limit,
        max_std_dev=std_dev_limit,
        # A comparison with NaN is false, as it should be.
        mean_error_passed=abs(condition.mean_error) <= mean_limit,
        std_dev_passed=condition.std_dev <= std_dev_limit,
        weighings=condition.count,
        weighings_required=weighings_required(condition.mass),
    )


def _check_positive(value: float, name: str) -> None:
    if not 0 < value < math.inf:
        raise ValueError(f'{name}: {value:g} is not a positive number')

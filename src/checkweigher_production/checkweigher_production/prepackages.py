# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Requirements for prepackages of one nominal quantity, EU Directive 76/211/EEC, Annex I.

The tolerable negative error (TNE) depends on the nominal quantity. A batch passes if its mean is at
least the nominal quantity, at most 2.5 % of the prepackages are below TU1 = nominal - TNE, and none
is below TU2 = nominal - 2 TNE. A TNE that is given in percent is rounded up to the next 0.1 g
(Annex I, 2.4).

Nothing here is type-approved for legal metrology. The module `reference_method` contains the
reference test of Annex II.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS
from checkweigher_dsp.rejection.batch_rules import ROUNDING

MAX_SHARE_BELOW_TU1 = 0.025  # largest fraction of a batch that may be below TU1.
# Range of nominal quantities in kg for which the directive has limits.
SMALLEST, LARGEST = 0.005, 10.0
# Smallest number of empty packages from which a tare is determined, and ratio of tare to nominal
# quantity below which the standard deviation of the tare is not limited.
_TARE_SAMPLE, _SMALL_TARE = 25, 0.05
# Step in kg to which a TNE in percent is rounded up.
_STEP = 1e-4

# Each row contains the largest nominal quantity in kg, and two summands of the TNE: the first is
# relative to the nominal quantity, and the second one is in kg.
_ROWS = (
    (0.05, 0.09, 0.0),
    (0.1, 0.0, 0.0045),
    (0.2, 0.045, 0.0),
    (0.3, 0.0, 0.009),
    (0.5, 0.03, 0.0),
    (1.0, 0.0, 0.015),
    (10.0, 0.015, 0.0),
)


@dataclass(frozen=True, slots=True)
class Limits:
    """Nominal quantity with its tolerable negative error, TU1 and TU2, all in kg."""

    nominal: float
    tolerable_negative_error: float
    tu1: float
    tu2: float


@dataclass(frozen=True, slots=True)
class BatchJudgement:
    """Result of the check of a batch against the three requirements of the directive."""

    limits: Limits
    count: int
    mean: float  # kg
    below_tu1: int  # number below TU1, which includes the number below TU2
    below_tu2: int  # number below TU2
    mean_passed: bool
    tu1_passed: bool
    tu2_passed: bool

    @property
    def share_below_tu1(self) -> float:
        """Fraction of the batch that is below TU1."""
        return self.below_tu1 / self.count

    @property
    def passed(self) -> bool:
        """Whether the batch meets all three requirements."""
        return self.mean_passed and self.tu1_passed and self.tu2_passed


def tolerable_negative_error(nominal: float) -> float:
    """Return the tolerable negative error in kg for a nominal quantity of 0.005..10 kg.

    Raises `ValueError` for any other quantity.
    """
    if not SMALLEST * (1 - ROUNDING) <= nominal <= LARGEST * (1 + ROUNDING):
        raise ValueError(
            f'nominal {nominal:g} kg is not in {SMALLEST:g}..{LARGEST:g} kg, for which the '
            'directive has limits'
        )
    _, share, constant = next(row for row in _ROWS if nominal <= row[0] * (1 + ROUNDING))
    # Without the tolerance `ROUNDING`, 9 % of 10 g would be rounded up from 0.9 g to 1.0 g, because
    # of the rounding error of the product.
    tenths = math.ceil(share * nominal / _STEP * (1 - ROUNDING))
    return tenths * _STEP + constant


def limits(nominal: float) -> Limits:
    """Return TNE, TU1 and TU2 for a nominal quantity of 0.005..10 kg.

    Raises `ValueError` for any other quantity.
    """
    error = tolerable_negative_error(nominal)
    return Limits(nominal, error, nominal - error, nominal - 2 * error)


def batch_of(masses: Sequence[float], done: str = 'judged') -> NDArray[np.float64]:
    """Return the masses of a batch as an array of shape (n,).

    Raises `ValueError` if there are no masses, or if one is NaN or infinite. `done` is the past
    participle in the message for an empty batch, such as 'judged' in "cannot be judged".
    """
    batch = np.array(masses, dtype=np.float64)
    if not len(batch):
        raise ValueError(f'a batch of no prepackages cannot be {done}')
    if not np.isfinite(batch).all():
        raise ValueError('a mass is not finite; leave out the prepackages that were not weighed')
    return batch


def judge_batch(masses: Iterable[float], nominal: float) -> BatchJudgement:
    """Check a batch against the three requirements of the directive.

    `masses` contains the net mass of each prepackage in kg, and `nominal` is the nominal quantity
    in kg. Raises `ValueError` if the batch is empty, a mass is not finite, or the directive has no
    limits for `nominal`.
    """
    batch = batch_of(list(masses))
    its, slack = limits(nominal), ROUNDING * nominal
    mean = float(batch.mean())
    below_tu1 = int(np.sum(batch < its.tu1 - slack))
    below_tu2 = int(np.sum(batch < its.tu2 - slack))
    return BatchJudgement(
        limits=its,
        count=len(batch),
        mean=mean,
        below_tu1=below_tu1,
        below_tu2=below_tu2,
        mean_passed=mean >= nominal - slack,
        tu1_passed=below_tu1 <= MAX_SHARE_BELOW_TU1 * len(batch) * (1 + ROUNDING),
        tu2_passed=below_tu2 == 0,
    )


@dataclass(frozen=True, slots=True)
class TareControl:
    """Sample of empty packages, from which a tare is determined. Masses are in kg.

    The rule is from Portaria Inmetro 248 of 17 July 2008 (Brazil and Mercosur). The mean of at
    least 25 packages is the tare if it is below 5 % of the nominal quantity, or if the standard
    deviation is at most a quarter of the tolerable negative error.
    """

    masses: tuple[float, ...]
    nominal: float

    @property
    def mean(self) -> float:
        """Mean of the sample."""
        return float(np.mean(self.masses))

    @property
    def std_dev(self) -> float:
        """Standard deviation of the sample, NaN for fewer than two packages."""
        return float(np.std(self.masses, ddof=1)) if len(self.masses) > 1 else math.nan

    @property
    def refusal(self) -> str:
        """Reason why the mean must not be used as the tare, or an empty string.

        Raises `ValueError` if the mean is not below 5 % of the nominal quantity, and the directive
        has no tolerable negative error for this quantity.
        """
        if len(self.masses) < _TARE_SAMPLE:
            return f'{len(self.masses)} empty packages, {_TARE_SAMPLE} are needed'
        if self.mean < _SMALL_TARE * self.nominal:
            return ''
        allowed = tolerable_negative_error(self.nominal) / 4
        if self.std_dev <= allowed * (1 + ROUNDING):
            return ''
        return (
            f'the standard deviation, {GRAMS * self.std_dev:.3f} g, is above a quarter of the '
            f'tolerable negative error, {GRAMS * allowed:.3f} g'
        )

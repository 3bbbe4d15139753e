# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reference test of an inspector on a batch, non-destructive, by one of two sampling plans.

Double sampling follows EU Directive 76/211/EEC, Annex II, section 2. The contents are judged by one
or two samples (2.2.1), and the mean by Student's t at 0.995 (2.3.3), x >= Qn - k s. The text
was read on legislation.gov.uk, which shows the criteria of 2.3.3 as pictures. Therefore k is taken
from the same tables in schedule 2 of UK SI 2006/659. It equals t(0.995, n - 1) / sqrt(n) of 2.3.1.

Single sampling judges one sample. Its numbers are those of UK SI 2006/659, schedule 2, 3.3 to 3.5.
The mean of this sample and TU2 are judged as in OIML R 87, whose text was not available: k is from
the Australian National Trade Measurement Regulations 2009, 4.34, and the rule that no prepackage in
the sample may be below TU2 is from the examples in the Guide to the Average Quantity System in
Australia.

A batch of fewer than 100 is tested whole (2.1.3). The directive has no numbers for that. UK SI
2006/659, schedule 2, allows 5 % of it below TU1 (3.6), and its mean must reach the nominal quantity
(4.7). None may be below TU2, because no such prepackage may be sold (76/211/EEC, Annex I, 5). A
batch at the end of the packing line may exceed 10,000 (2.1.2).

Nothing here is type-approved for legal metrology.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
import math

import numpy as np

from checkweigher_dsp.rejection.batch_rules import ROUNDING
from checkweigher_production.prepackages import batch_of, limits

WHOLE_BELOW = 100  # prepackages; a smaller batch is tested whole
_MAX_DEFECTIVE_PERCENT = 5  # of a batch that is tested whole


class SamplingPlan(Enum):
    """Plan for drawing samples from a batch."""

    DOUBLE = 'double'  # 76/211/EEC, Annex II
    SINGLE = 'single'  # UK SI 2006/659 and OIML R 87


# Largest batch of a row; then, for the first sample and for both samples together: the size, the
# largest number of defective prepackages to accept, and the smallest number to reject.
_CONTENTS = {
    SamplingPlan.DOUBLE: (
        (500, ((30, 1, 3), (60, 4, 5))),
        (3_200, ((50, 2, 5), (100, 6, 7))),
        (math.inf, ((80, 3, 7), (160, 8, 9))),
    ),
    SamplingPlan.SINGLE: (
        (500, ((50, 3, 4),)),
        (3_200, ((80, 5, 6),)),
        (math.inf, ((125, 7, 8),)),
    ),
}
# Largest batch of a row, size of the sample, and k.
_MEANS = {
    SamplingPlan.DOUBLE: ((500, 30, 0.503), (math.inf, 50, 0.379)),
    SamplingPlan.SINGLE: ((500, 50, 0.379), (3_200, 80, 0.295), (math.inf, 125, 0.234)),
}


@dataclass(frozen=True, slots=True)
class SampleResult:
    """Number of defective prepackages in the samples up to this one, with its limits."""

    count: int  # of the samples up to this one
    defective: int  # below TU1
    accept: int
    reject: int


@dataclass(frozen=True, slots=True)
class ReferenceTest:
    """Result of the reference test. Masses are in kg, `drawn` are positions in the batch."""

    plan: SamplingPlan
    batch_size: int
    seed: int
    drawn: tuple[int, ...]
    samples: tuple[SampleResult, ...]
    below_tu2: int  # number among the drawn prepackages
    tu2_decides: bool  # whether a single prepackage below TU2 fails the contents
    contents_passed: bool
    mean_count: int
    mean: float
    std_dev: float  # of the sample of the mean; NaN for one prepackage
    k: float  # 0 if the batch is tested whole
    mean_limit: float  # nominal - k std_dev
    mean_passed: bool

    @property
    def passed(self) -> bool:
        """Whether the batch passes both checks."""
        return self.contents_passed and self.mean_passed


def reference_test(
    masses: Sequence[float],
    nominal: float,
    seed: int = 1,
    plan: SamplingPlan = SamplingPlan.DOUBLE,
) -> ReferenceTest:
    """Draw the samples of a batch at random by a plan, and judge the batch by them.

    `masses` are the contents of all prepackages and `nominal` is the nominal quantity, in kg.
    `seed` is the seed of the random draw. A batch of fewer than 100 is tested whole.

    Raises `ValueError` if the batch is empty, a mass is not finite or the directive has no limits
    for `nominal`.
    """
    batch = batch_of(masses, 'tested')
    its, size, slack = limits(nominal), len(batch), ROUNDING * nominal
    whole = size < WHOLE_BELOW
    generator = np.random.Generator(np.random.PCG64(seed))
    order = np.arange(size) if whole else generator.permutation(size)
    samples = _samples(batch[order] < its.tu1 - slack, plan)
    number = samples[-1].count
    below_tu2 = int(np.sum(batch[order[:number]] < its.tu2 - slack))
    of_plan = next((n, k) for most, n, k in _MEANS[plan] if size <= most)
    count, k = (size, 0.0) if whole else of_plan
    drawn = batch[order[:count]]
    mean = float(drawn.mean())
    std_dev = float(drawn.std(ddof=1)) if count > 1 else math.nan
    limit = nominal - k * std_dev if k else nominal
    tu2_decides = whole or plan is SamplingPlan.SINGLE
    return ReferenceTest(
        plan=plan,
        batch_size=size,
        seed=seed,
        drawn=tuple(order[:number].tolist()),
        samples=samples,
        below_tu2=below_tu2,
        tu2_decides=tu2_decides,
        contents_passed=samples[-1].defective <= samples[-1].accept
        and not (tu2_decides and below_tu2),
        mean_count=count,
        mean=mean,
        std_dev=std_dev,
        k=k,
        mean_limit=limit,
        mean_passed=mean >= limit - slack,
    )


def _samples(defective: np.ndarray, plan: SamplingPlan) -> tuple[SampleResult, ...]:
    size = len(defective)
    if size < WHOLE_BELOW:
        accept = _MAX_DEFECTIVE_PERCENT * size // 100
        return (SampleResult(size, int(defective.sum()), accept, accept + 1),)
    rows = next(rows for most, rows in _CONTENTS[plan] if size <= most)
    first, *second = (SampleResult(n, int(defective[:n].sum()), a, r) for n, a, r in rows)
    return (first, *second) if first.accept < first.defective < first.reject else (first,)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Non-destructive reference test of a batch, as an inspector makes it, by one of two plans.

Double sampling follows EU Directive 76/211/EEC, Annex II, section 2. The contents are judged by one
or two samples (2.2.1). The mean x of n contents with the standard deviation s must satisfy
x >= Qn - k s, where Qn is the nominal quantity and k = t(0.995, n - 1) / sqrt(n) (2.3.1, 2.3.3).
The text was read on legislation.gov.uk, which shows the criteria of 2.3.3 as images. The values of
k are therefore from the same tables in schedule 2 of UK SI 2006/659.

In single sampling, one sample is judged. The sample sizes and the acceptance and rejection numbers
are from UK SI 2006/659, schedule 2, 3.3 to 3.5. The mean and TU2 are judged as in OIML R 87, whose
text was not available. Therefore k is from the Australian National Trade Measurement Regulations
2009, 4.34. The rule that no prepackage in the sample may be below TU2 is from the examples in the
Guide to the Average Quantity System in Australia.

All prepackages of a batch of fewer than 100 are tested (2.1.3). The directive has no criteria for a
batch of fewer than 100. According to UK SI 2006/659, schedule 2, at most 5 % of the batch may be
below TU1 (3.6), and the mean of the batch must be at least the nominal quantity (4.7). No
prepackage may be below TU2, because such a prepackage may not be sold (76/211/EEC, Annex I, 5). A
batch at the end of the packing line may have more than 10,000 prepackages (2.1.2).

Nothing here is type-approved for legal metrology.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
import math

import numpy as np

from checkweigher_dsp.rejection.batch_rules import ROUNDING
from checkweigher_production.prepackages import batch_of, limits

WHOLE_BELOW = 100  # number of prepackages below which all of them are tested
_MAX_DEFECTIVE_PERCENT = 5  # largest percentage below TU1 if all prepackages are tested


class SamplingPlan(Enum):
    """Plan for drawing samples from a batch."""

    # Plan of 76/211/EEC, Annex II.
    DOUBLE = 'double'
    # Plan of UK SI 2006/659 and OIML R 87.
    SINGLE = 'single'


# Each row contains the largest batch size, and three numbers for the first sample and for both
# samples together. The three numbers are the sample size, the largest number of defective
# prepackages with which the batch is accepted, and the smallest number with which the batch is
# rejected.
_CONTENTS = {
    SamplingPlan.DOUBLE: (
        (500, ((30, 1, 3), (60, 4, 5))),
        (3_200, ((50, 2, 5), (100, 6, 7))),
        (math.inf, ((80, 3, 7), (160, 8, 9))),
    ),
    SamplingPlan.SINGLE: ((500, ((50, 3, 4),)), (3_200, ((80, 5, 6),)), (math.inf, ((125, 7, 8),))),
}
# Each row contains the largest batch size, the sample size, and k.
_MEANS = {
    SamplingPlan.DOUBLE: ((500, 30, 0.503), (math.inf, 50, 0.379)),
    SamplingPlan.SINGLE: ((500, 50, 0.379), (3_200, 80, 0.295), (math.inf, 125, 0.234)),
}


@dataclass(frozen=True, slots=True)
class SampleResult:
    """Cumulative number of defective prepackages after a sample, and the limits of this number."""

    count: int  # cumulative number of prepackages in the samples
    defective: int  # cumulative number of prepackages below TU1
    accept: int  # largest number of defective prepackages with which the batch is accepted
    reject: int  # smallest number of defective prepackages with which the batch is rejected


@dataclass(frozen=True, slots=True)
class ReferenceTest:
    """Result of a reference test. Masses are in kg."""

    plan: SamplingPlan
    batch_size: int
    seed: int
    drawn: tuple[int, ...]  # positions of the drawn prepackages in the batch, from 0
    samples: tuple[SampleResult, ...]
    below_tu2: int  # number of drawn prepackages below TU2
    tu2_decides: bool  # whether the batch fails if at least one drawn prepackage is below TU2
    contents_passed: bool
    mean_count: int  # size of the sample for the mean
    mean: float
    std_dev: float  # standard deviation of the sample for the mean, NaN for one prepackage
    k: float  # factor of std_dev in mean_limit, 0 if all prepackages are tested
    mean_limit: float  # smallest mean that passes: nominal - k std_dev, or nominal if k is 0
    mean_passed: bool

    @property
    def passed(self) -> bool:
        """Whether the batch passes the check of the contents and the check of the mean."""
        return self.contents_passed and self.mean_passed


def reference_test(
    masses: Sequence[float], nominal: float, seed: int = 1, plan: SamplingPlan = SamplingPlan.DOUBLE
) -> ReferenceTest:
    """Test a batch by random samples.

    `masses` contains the net mass of each prepackage in kg, `nominal` is the nominal quantity in
    kg, and `seed` is the seed of the random draw. If there are fewer than 100 prepackages, all of
    them are tested.

    Raises `ValueError` if the batch is empty, a mass is not finite, or the directive has no limits
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

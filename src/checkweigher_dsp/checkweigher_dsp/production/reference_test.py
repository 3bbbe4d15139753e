# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reference test of an inspector on a batch: EU Directive 76/211/EEC, Annex II, section 2.

Non-destructive testing: the contents by a double sampling plan (2.2.1), and the mean by
Student's t at 0.995 (2.3.3), x >= Qn - k s. Sources: the text of the directive as
legislation.gov.uk publishes it; it shows the criteria of 2.3.3 as pictures, so k is from the
same tables in schedule 2 of UK SI 2006/659, and is t(0.995, n - 1) / sqrt(n) of 2.3.1. A
batch below 100 is tested whole (2.1.3), for which the directive has no numbers: the
mean has to reach the nominal quantity (UK SI 2006/659, 4.7), and the shares below TU1 and TU2 are
held to the packers' rules, which is this program's choice. A batch that is checked at the end of
the packing line is not limited to 10,000 (2.1.2).

Nothing here is type-approved for legal metrology.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from checkweigher_dsp.production.prepackages import MAX_SHARE_BELOW_TU1, ROUNDING, limits

WHOLE_BELOW = 100  # prepackages, tested one by one

# Size of the batch up to which a row holds; then for the first and the second sample the number of
# both together, and of the defective ones in them the most to accept and the fewest to reject.
_PLANS = (
    (500, ((30, 1, 3), (60, 4, 5))),
    (3_200, ((50, 2, 5), (100, 6, 7))),
    (math.inf, ((80, 3, 7), (160, 8, 9))),
)
# Size of the batch up to which a row holds, number in the sample, and k.
_MEANS = ((500, 30, 0.503), (math.inf, 50, 0.379))


@dataclass(frozen=True, slots=True)
class SampleResult:
    """Defective prepackages in the samples up to this one, and the numbers that decide."""

    count: int  # of the samples up to this one
    defective: int  # below TU1
    accept: int
    reject: int


@dataclass(frozen=True, slots=True)
class ReferenceTest:
    """Result of the reference test; masses in kg, `drawn` are positions in the batch."""

    batch_size: int
    seed: int
    drawn: tuple[int, ...]
    samples: tuple[SampleResult, ...]
    below_tu2: int  # among those drawn
    contents_passed: bool
    mean_count: int
    mean: float
    std_dev: float  # of the sample of the mean; NaN of one prepackage
    k: float  # 0 where the batch is tested whole
    mean_limit: float  # nominal - k std_dev
    mean_passed: bool

    @property
    def passed(self) -> bool:
        """Whether the batch is acceptable by both checks."""
        return self.contents_passed and self.mean_passed


def reference_test(masses: Sequence[float], nominal: float, seed: int = 1) -> ReferenceTest:
    """Draw the samples of a batch at random and judge it by them.

    Parameters
    ----------
    masses : sequence of float
        kg, of the contents of every prepackage of the batch.
    nominal : float
        kg.
    seed : int
        Of the draw: the same seed draws the same prepackages.

    Raises
    ------
    ValueError
        If the batch is empty, a mass is not finite or the directive has no limits for `nominal`.
    """
    batch = np.array(masses, dtype=np.float64)
    if not len(batch):
        raise ValueError('a batch of no prepackages cannot be tested')
    if not np.isfinite(batch).all():
        raise ValueError('a mass is not finite; leave out the prepackages that were not weighed')
    its, size, slack = limits(nominal), len(batch), ROUNDING * nominal
    # The prepackages in the order in which they are drawn.
    order = np.arange(size)
    if size >= WHOLE_BELOW:
        order = np.random.Generator(np.random.PCG64(seed)).permutation(size)
    defective = batch[order] < its.tu1 - slack
    samples = _samples(defective)
    number = samples[-1].count
    below_tu2 = int(np.sum(batch[order[:number]] < its.tu2 - slack))
    count, k = next((n, k) for most, n, k in _MEANS if size <= most)
    if size < WHOLE_BELOW:
        count, k = size, 0.0
    drawn = batch[order[:count]]
    mean = float(drawn.mean())
    std_dev = float(drawn.std(ddof=1)) if count > 1 else math.nan
    limit = nominal - k * std_dev if k else nominal
    contents = samples[-1].defective <= samples[-1].accept
    return ReferenceTest(
        size, seed, tuple(order[:number].tolist()), samples, below_tu2,
        contents_passed=contents and (size >= WHOLE_BELOW or not below_tu2),
        mean_count=count, mean=mean, std_dev=std_dev, k=k, mean_limit=limit,
        mean_passed=mean >= limit - slack,
    )  # fmt: skip


def _samples(defective: np.ndarray) -> tuple[SampleResult, ...]:
    """Return one sample, or both; the last of them decides."""
    size = len(defective)
    if size < WHOLE_BELOW:
        accept = math.floor(MAX_SHARE_BELOW_TU1 * size * (1 + ROUNDING))
        return (SampleResult(size, int(defective.sum()), accept, accept + 1),)
    plan = next(rows for most, rows in _PLANS if size <= most)
    first, second = (SampleResult(n, int(defective[:n].sum()), a, r) for n, a, r in plan)
    undecided = first.accept < first.defective < first.reject
    return (first, second) if undecided else (first,)

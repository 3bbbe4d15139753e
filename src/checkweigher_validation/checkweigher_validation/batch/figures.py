# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a batch for its report, with reference test, histogram and control chart."""

from collections import Counter
from dataclasses import asdict, dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import Decision
from checkweigher_production.control_chart import ControlChart, control_chart
from checkweigher_production.prepackages import LARGEST, SMALLEST, BatchJudgement, judge_batch
from checkweigher_production.recipes import Product
from checkweigher_production.reference_method import ReferenceTest, SamplingPlan, reference_test
from checkweigher_validation.accuracy.tables import plain_values
from checkweigher_validation.batch.batch import Batch, Part

_MOST_BINS = 60  # largest number of bins of the histogram


@dataclass(frozen=True, slots=True)
class PartFigures:
    """Statistics of one product in a batch. A mass is the mass of the contents in kg.

    All values except the numbers of decisions and reasons are computed from the accepted items.
    `judgement` and `reference` are None if no item was accepted, or if 76/211/EEC has no limits for
    the nominal weight. `chart` is None if there are too few accepted items for two subgroups.
    """

    product: Product
    decisions: dict[str, int]  # number of items with each decision.
    # Number of items that were not accepted, by reason, in descending order. An item without
    # reasons is counted under the name of its decision.
    reasons: dict[str, int]
    masses: NDArray[np.float64]  # mass of each accepted item, (n,)
    counts: NDArray[np.int64]  # number of items in each bin of the histogram, (bins,)
    edges: NDArray[np.float64]  # edges of the bins, (bins + 1,), or (0,) without accepted items
    chart: ControlChart | None
    judgement: BatchJudgement | None
    reference: ReferenceTest | None

    @property
    def items(self) -> int:
        """Number of items, including items that were not accepted."""
        return sum(self.decisions.values())

    @property
    def mean(self) -> float:
        """Mean of the masses, or NaN if no item was accepted."""
        return float(self.masses.mean()) if len(self.masses) else math.nan

    @property
    def std_dev(self) -> float:
        """Standard deviation of the masses, or NaN for fewer than two accepted items."""
        return float(self.masses.std(ddof=1)) if len(self.masses) > 1 else math.nan

    @property
    def giveaway(self) -> float:
        """Mean of the masses minus the nominal weight, or NaN if no item was accepted."""
        return self.mean - self.product.nominal


def figures_of(part: Part, seed: int, plan: SamplingPlan = SamplingPlan.DOUBLE) -> PartFigures:
    """Return the statistics of a product in a batch.

    `seed` and `plan` are the seed and the sampling plan of the reference test.
    """
    nominal, decisions = part.product.nominal, Counter(item.decision for item in part.items)
    rejected = [item for item in part.items if item.decision is not Decision.ACCEPT]
    reasons = Counter(why for item in rejected for why in item.reasons or (item.decision.name,))
    masses = np.array([item.mass for item in part.items if item.decision is Decision.ACCEPT])
    rules, test = None, None
    if len(masses) and SMALLEST <= nominal <= LARGEST:
        rules = judge_batch(masses, nominal)
        test = reference_test(masses.tolist(), nominal, seed, plan)
    return PartFigures(
        part.product,
        {each.name: decisions[each] for each in Decision},
        dict(reasons.most_common()),
        masses,
        *_histogram(masses),
        control_chart(masses.tolist()),
        rules,
        test,
    )


def _histogram(masses: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the counts and the edges of a histogram with bins by the Freedman-Diaconis rule.

    The histogram has at most 60 bins, one bin if all masses are equal, and no bins if there are no
    masses.
    """
    if not len(masses):
        return np.zeros(0, np.int64), np.zeros(0)
    edges = np.histogram_bin_edges(masses, 'fd' if np.ptp(masses) > 0 else 1)
    if len(edges) > _MOST_BINS + 1:
        edges = np.histogram_bin_edges(masses, _MOST_BINS)
    return np.histogram(masses, edges)


def as_json(batch: Batch, parts: list[PartFigures]) -> dict[str, Any]:
    """Return the report of a batch as plain values. Masses are in kg. Unknown values are None."""
    content: dict[str, Any] = {
        'batch': batch.name,
        'source': batch.source,
        'sha256': batch.sha256 or None,
        'sha256_in_audit_log': batch.in_log,
        'audit_log': batch.log or None,
        'faults': batch.faults,
        'legal_software_sha256': batch.software or None,
        'begin': batch.begin or None,
        'end': batch.end or None,
        'strays': batch.strays,
        'products': [_part_as_json(part) for part in parts],
        'stops': batch.stops,
        'alarms': [asdict(each) for each in batch.alarms],
        'filler': [asdict(each) for each in batch.corrections],
        'signatures': [asdict(each) for each in batch.signatures],
        'changes': [asdict(entry) for entry in batch.changes],
    }
    return plain_values(content)


def _part_as_json(part: PartFigures) -> dict[str, Any]:
    rules, test = part.judgement, part.reference
    return {
        'product': part.product.name,
        'nominal': part.product.nominal,
        'tare': part.product.tare,
        'items': part.items,
        'decisions': part.decisions,
        'reasons': part.reasons,
        'mean': part.mean,
        'std_dev': part.std_dev,
        'giveaway': part.giveaway,
        'histogram': {'edges': part.edges, 'counts': part.counts},
        'control_chart': part.chart and asdict(part.chart),
        'rules': rules and asdict(rules) | {'share_below_tu1': rules.share_below_tu1},
        'reference_test': test and asdict(test) | {'plan': test.plan.value},
    }

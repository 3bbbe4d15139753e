# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of a batch in numbers: counts, mean, rules, reference test, histogram, control chart."""

from collections import Counter
from dataclasses import asdict, dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import Decision
from checkweigher_production.control_chart import ControlChart, control_chart
from checkweigher_production.prepackages import (
    LARGEST,
    SMALLEST,
    BatchJudgement,
    judge_batch,
)
from checkweigher_production.recipes import Product
from checkweigher_production.reference_method import (
    ReferenceTest,
    SamplingPlan,
    reference_test,
)
from checkweigher_validation.batch.batch import Batch, Part

_MOST_BINS = 60


@dataclass(frozen=True, slots=True)
class PartFigures:
    """Figures of one product in a batch; masses in kg, of the contents.

    Mean, standard deviation, rules, reference test, histogram and control chart are those of the
    accepted items. `judgement` and `reference` are None where nothing was accepted or 76/211/EEC
    has no limits for the nominal weight.
    """

    product: Product
    decisions: dict[str, int]
    reasons: dict[str, int]  # of the items that were not accepted, the most frequent first
    masses: NDArray[np.float64]  # of the accepted items, (n,)
    mean: float
    std_dev: float
    edges: NDArray[np.float64]  # of the histogram, (bins + 1,)
    counts: NDArray[np.int64]  # (bins,)
    chart: ControlChart | None
    judgement: BatchJudgement | None
    reference: ReferenceTest | None

    @property
    def items(self) -> int:
        """Number of all items."""
        return sum(self.decisions.values())

    @property
    def giveaway(self) -> float:
        """Mean above the nominal weight."""
        return self.mean - self.product.nominal


def figures_of(part: Part, seed: int, plan: SamplingPlan = SamplingPlan.DOUBLE) -> PartFigures:
    """Return the figures of a product in a batch; `seed` draws the reference test by a plan."""
    accepted = [item for item in part.items if item.decision is Decision.ACCEPT]
    masses = np.array([item.mass for item in accepted])
    nominal = part.product.nominal
    judged = len(masses) > 0 and SMALLEST <= nominal <= LARGEST
    rejected = [item for item in part.items if item.decision is not Decision.ACCEPT]
    reasons = Counter(why for item in rejected for why in item.reasons or (item.decision.name,))
    counts, edges = _histogram(masses)
    return PartFigures(
        part.product,
        {each.name: sum(item.decision is each for item in part.items) for each in Decision},
        dict(reasons.most_common()),
        masses,
        mean=float(masses.mean()) if len(masses) else math.nan,
        std_dev=float(masses.std(ddof=1)) if len(masses) > 1 else math.nan,
        edges=edges,
        counts=counts,
        chart=control_chart(masses.tolist()),
        judgement=judge_batch(masses, nominal) if judged else None,
        reference=reference_test(masses.tolist(), nominal, seed, plan) if judged else None,
    )


def _histogram(masses: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return counts and edges by the rule of Freedman and Diaconis, some bins at most."""
    if not len(masses):
        return np.zeros(0, np.int64), np.zeros(0)
    edges = np.histogram_bin_edges(masses, 'fd' if np.ptp(masses) > 0 else 1)
    if len(edges) > _MOST_BINS + 1:
        edges = np.histogram_bin_edges(masses, _MOST_BINS)
    counts, edges = np.histogram(masses, edges)
    return counts, edges


def as_json(batch: Batch, parts: list[PartFigures]) -> dict[str, Any]:
    """Return a report for a program; masses in kg, what is not known None."""
    content: dict[str, Any] = _known({
        'batch': batch.name, 'source': batch.source, 'sha256': batch.sha256 or None,
        'sha256_in_audit_log': batch.in_log,
        'begin': batch.begin or None, 'end': batch.end or None, 'strays': batch.strays,
        'products': [_part_as_json(part) for part in parts],
        'stops': batch.stops, 'filler': batch.corrections,
        'changes': [asdict(entry) for entry in batch.changes],
    })  # fmt: skip
    return content


def _part_as_json(part: PartFigures) -> dict[str, Any]:
    made: dict[str, Any] = {
        'product': part.product.name, 'nominal': part.product.nominal, 'tare': part.product.tare,
        'items': part.items, 'decisions': part.decisions, 'reasons': part.reasons,
        'mean': part.mean, 'std_dev': part.std_dev, 'giveaway': part.giveaway,
        'histogram': {'edges': part.edges, 'counts': part.counts},
        'control_chart': asdict(part.chart) if part.chart else None,
        'rules': None, 'reference_test': None,
    }  # fmt: skip
    if part.judgement is not None:
        share = part.judgement.share_below_tu1
        made['rules'] = asdict(part.judgement) | {'share_below_tu1': share}
    if part.reference is not None:
        plan = part.reference.plan.value
        made['reference_test'] = asdict(part.reference) | {'plan': plan}
    return made


def _known(value: Any) -> Any:
    """Return a value as JSON has it, None for what is no number."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {name: _known(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_known(each) for each in value]
    return _known(value.tolist()) if isinstance(value, np.ndarray) else value

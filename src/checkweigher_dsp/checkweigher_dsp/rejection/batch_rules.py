# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batch rules for prepackages according to EU Directive 76/211/EEC, Annex I, section 1.

Two rules must be satisfied after each item, not only at the end of the batch. By the first rule, an
item below the tolerance limit TU1 is accepted only if the fraction of such items among the accepted
items remains within a quota. By the second rule, which is optional, an item below the nominal
weight is accepted only if the mean of the accepted items remains at or above the nominal weight.
"""

from dataclasses import dataclass, replace
from typing import Any

from checkweigher_core.records import Decision, ProductOnLine, Verdict
from checkweigher_core.records.reasons import Reason

ROUNDING = 1e-9  # relative tolerance for rounding errors
_COUNTS = ('items', 'accepted', 'below_tu1', 'surplus')


@dataclass(frozen=True, slots=True)
class BatchTally:
    """Counts of the items of one product in one batch."""

    product: str = ''  # name of the product
    batch: str = ''  # name of the batch
    items: int = 0  # number of items
    accepted: int = 0  # number of accepted items
    below_tu1: int = 0  # number of accepted items below TU1.
    # Sum over the accepted items of mass minus nominal weight, in kg. Items of a product without a
    # nominal weight are not included.
    surplus: float = 0.0

    @classmethod
    def of(cls, record: Verdict | ProductOnLine) -> 'BatchTally':
        """Return the names and counts of the batch that a record contains."""
        counts = (getattr(record, f'batch_{name}') for name in _COUNTS)
        return cls(record.product, record.batch, *counts)

    @property
    def counts(self) -> dict[str, Any]:
        """Counts, with the names of their fields in `Verdict` and `ProductOnLine`."""
        return {f'batch_{name}': getattr(self, name) for name in _COUNTS}

    @property
    def key(self) -> tuple[str, str]:
        """Names of the product and the batch."""
        return self.product, self.batch

    def has_room(self, quota: float) -> bool:
        """Return whether the `quota` allows the next accepted item to be below TU1."""
        return self.below_tu1 + 1 <= quota * (self.accepted + 1) * (1 + ROUNDING)


class BatchRules:
    """Batch rules, with the counts of each batch.

    Counts of the same batch may come from different sources, such as the product node and verdicts
    before a restart. The counts with the most items are the latest, because counts only increase.
    """

    def __init__(self) -> None:
        self._tallies: dict[tuple[str, str], BatchTally] = {}

    def remember(self, tally: BatchTally) -> BatchTally:
        """Store the counts of a batch, unless later counts are known, and return the latest."""
        known = self._tallies.get(tally.key, tally)
        latest = self._tallies[tally.key] = known if known.items >= tally.items else tally
        return latest

    def judge(self, verdict: Verdict, product: ProductOnLine) -> Verdict:
        """Apply the rules to a verdict, and return it with the counts of its batch.

        The decision ACCEPT becomes UNDER if the item would break a rule.
        """
        tally = self.remember(BatchTally.of(product))
        decision, reasons = verdict.decision, verdict.reasons
        if decision is Decision.ACCEPT and (broken := broken_rules(verdict.mass, tally, product)):
            decision, reasons = Decision.UNDER, broken
        tally = count(verdict.mass, tally, product, accepted=decision is Decision.ACCEPT)
        self._tallies[tally.key] = tally
        return replace(
            verdict,
            decision=decision,
            reasons=reasons,
            product=tally.product,
            batch=tally.batch,
            **tally.counts,
        )


def broken_rules(mass: float, tally: BatchTally, product: ProductOnLine) -> tuple[str, ...]:
    """Return a reason for each rule that would be broken if an item were accepted.

    `mass` is the mass of the item in kg. The result is empty if no rule would be broken.
    """
    broken = []
    if _below_tu1(mass, product) and not tally.has_room(product.tu1_quota):
        broken.append(Reason.TU1_QUOTA.value)
    if product.mean_value:
        slack = ROUNDING * product.nominal
        lacks = mass - product.nominal
        if lacks < -slack and tally.surplus + lacks < -slack * (tally.accepted + 1):
            broken.append(Reason.MEAN_VALUE_REQUIREMENT.value)
    return tuple(broken)


def count(mass: float, tally: BatchTally, product: ProductOnLine, *, accepted: bool) -> BatchTally:
    """Return the counts after one more item, whose `mass` is in kg."""
    tally = replace(tally, items=tally.items + 1)
    if not accepted:
        return tally
    return replace(
        tally,
        accepted=tally.accepted + 1,
        below_tu1=tally.below_tu1 + _below_tu1(mass, product),
        surplus=tally.surplus + (mass - product.nominal if product.nominal else 0.0),
    )


def _below_tu1(mass: float, product: ProductOnLine) -> bool:
    return mass < product.tu1 * (1 - ROUNDING)

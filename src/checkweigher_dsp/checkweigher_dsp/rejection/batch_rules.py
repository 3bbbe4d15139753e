# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The packers' rules over a running batch: EU Directive 76/211/EEC, Annex I, section 1.

Both rules hold after each item, not only at the end of the batch. An item below TU1 is accepted
only if the share of such items among the accepted ones stays within the quota. If the mean value
is required, an item below the nominal weight is accepted only if the mean of the accepted items
stays at or above the nominal weight.
"""

from dataclasses import dataclass, replace
from typing import Any

from checkweigher_core.records import Decision, ProductOnLine, Verdict
from checkweigher_core.records.reasons import Reason

# Relative tolerance, so that rounding never puts a mass below a limit that it equals.
ROUNDING = 1e-9
_COUNTS = ('items', 'accepted', 'below_tu1', 'surplus')


@dataclass(frozen=True, slots=True)
class BatchTally:
    """Counts of a product in a batch.

    Attributes
    ----------
    product, batch : str
        Names of the product and of the batch.
    items : int
        Number of items.
    accepted : int
        Number of accepted items.
    below_tu1 : int
        Number of accepted items below TU1, if the recipe has a quota.
    surplus : float
        Sum of the masses of the accepted items above the nominal weight in kg.
    """

    product: str = ''
    batch: str = ''
    items: int = 0
    accepted: int = 0
    below_tu1: int = 0
    surplus: float = 0.0

    @classmethod
    def of(cls, record: Verdict | ProductOnLine) -> 'BatchTally':
        """Return the counts that a record carries."""
        counts = (getattr(record, f'batch_{name}') for name in _COUNTS)
        return cls(record.product, record.batch, *counts)

    @property
    def counts(self) -> dict[str, Any]:
        """The counts as the fields of `Verdict` and `ProductOnLine`."""
        return {f'batch_{name}': getattr(self, name) for name in _COUNTS}

    @property
    def key(self) -> tuple[str, str]:
        """Product and batch."""
        return self.product, self.batch

    def has_room(self, quota: float) -> bool:
        """Return whether the next item may be below TU1; `quota` is their largest share."""
        return self.below_tu1 + 1 <= quota * (self.accepted + 1) * (1 + ROUNDING)


class BatchRules:
    """Rules over the running batches, with the counts of each batch.

    The counts of a batch only grow. If one batch has several tallies (from the product node, from
    verdicts before a restart), the one with the most items is therefore the latest.
    """

    def __init__(self) -> None:
        self._tallies: dict[tuple[str, str], BatchTally] = {}

    def remember(self, tally: BatchTally) -> BatchTally:
        """Return the later counts of a batch: `tally`, or the counts known so far."""
        known = self._tallies.get(tally.key, tally)
        latest = self._tallies[tally.key] = known if known.items >= tally.items else tally
        return latest

    def judge(self, verdict: Verdict, product: ProductOnLine) -> Verdict:
        """Return a verdict with the rules applied, and with the counts of its batch."""
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
    """Return the rules that an item would break if it was accepted; `mass` in kg."""
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
    """Return the tally with one more item; `mass` in kg."""
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

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The packers' rules over a running batch: EU Directive 76/211/EEC, Annex I, section 1.

Both rules hold after each item, not at the end of the batch alone. An item below TU1 is accepted
only if the share of such items among the accepted ones stays within the quota. Where the mean value
is required, an item below the nominal weight is accepted only if the mean of the accepted ones
stays at or above that.
"""

from dataclasses import dataclass, replace
from typing import Any

from checkweigher_core.records import Decision, ProductOnLine, Verdict
from checkweigher_core.records.reasons import Reason

_MAX_TALLIES = 1_000

# A mass that lies on a limit must not fall below it by a rounding error; far below a load cell.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class BatchTally:
    """Counts of a product in a batch.

    `accepted` items are among all `items`, and `below_tu1` among the accepted ones, where the
    recipe has a quota. `surplus` is the sum of what the accepted ones have above the nominal
    weight, kg.
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
        return cls(
            record.product, record.batch, record.batch_items, record.batch_accepted,
            record.batch_below_tu1, record.batch_surplus,
        )  # fmt: skip

    @property
    def counts(self) -> dict[str, Any]:
        """The counts as the fields of `Verdict` and `ProductOnLine`."""
        return {
            'batch_items': self.items, 'batch_accepted': self.accepted,
            'batch_below_tu1': self.below_tu1, 'batch_surplus': self.surplus,
        }  # fmt: skip

    @property
    def key(self) -> tuple[str, str]:
        """Product and batch."""
        return self.product, self.batch

    def has_room(self, quota: float) -> bool:
        """Tell whether the next item may be below TU1, of which a share of `quota` may be."""
        return self.below_tu1 + 1 <= quota * (self.accepted + 1) * (1 + ROUNDING)


class BatchRules:
    """The counts of the batches, and the verdicts by the rules over them.

    The counts of a batch only grow. So of what several remember of one batch (the product node, the
    verdicts before a restart) the tally with the most items is the last one, and nothing is counted
    twice.
    """

    def __init__(self) -> None:
        self._tallies: dict[tuple[str, str], BatchTally] = {}
        self._product: ProductOnLine | None = None

    def remember(self, tally: BatchTally) -> None:
        """Take counts of a batch, unless those that are known are later ones."""
        known = self._tallies.pop(tally.key, tally)
        self._tallies[tally.key] = known if known.items >= tally.items else tally
        if len(self._tallies) > _MAX_TALLIES:
            del self._tallies[next(iter(self._tallies))]

    def judge(self, verdict: Verdict, product: ProductOnLine, **others: Any) -> Verdict:
        """Return a verdict with the rules applied and with its counts; `others` are set as well."""
        if product is not self._product:
            self._product = product
            self.remember(BatchTally.of(product))
        key = product.product, product.batch
        tally = self._tallies[key]
        decision, reasons = verdict.decision, verdict.reasons
        if decision is Decision.ACCEPT and (broken := broken_rules(verdict.mass, tally, product)):
            decision, reasons = Decision.UNDER, broken
        tally = count(verdict.mass, tally, product, accepted=decision is Decision.ACCEPT)
        self._tallies[key] = tally
        return replace(
            verdict, decision=decision, reasons=reasons, product=tally.product, batch=tally.batch,
            **tally.counts, **others,
        )  # fmt: skip


def broken_rules(mass: float, tally: BatchTally, product: ProductOnLine) -> tuple[str, ...]:
    """Return the rules that an item of a mass in kg would break if it was accepted."""
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
    """Return the tally with one item more."""
    items = tally.items + 1
    if not accepted:
        return replace(tally, items=items)
    surplus = tally.surplus + (mass - product.nominal if product.nominal else 0.0)
    below_tu1 = tally.below_tu1 + _below_tu1(mass, product)
    return BatchTally(*tally.key, items, tally.accepted + 1, below_tu1, surplus)


def _below_tu1(mass: float, product: ProductOnLine) -> bool:
    return mass < product.tu1 * (1 - ROUNDING)

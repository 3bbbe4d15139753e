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

from checkweigher_dsp.production.prepackages import ROUNDING
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import Decision, Verdict
from checkweigher_dsp.rejection.parameters import RejectParameters

_MAX_TALLIES = 1_000


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
    def of(cls, verdict: Verdict) -> 'BatchTally':
        """Return the counts that a verdict carries."""
        return cls(
            verdict.product, verdict.batch, verdict.batch_items, verdict.batch_accepted,
            verdict.batch_below_tu1, verdict.batch_surplus,
        )  # fmt: skip

    @classmethod
    def begun(cls, parameters: RejectParameters) -> 'BatchTally':
        """Return the counts with which the product in these parameters goes on in its batch."""
        items, accepted, below_tu1, surplus = parameters.batch_counts
        counts = int(items), int(accepted), int(below_tu1), surplus
        return cls(parameters.product, parameters.batch, *counts)

    @property
    def counts(self) -> tuple[float, ...]:
        """The counts as `batch_counts` of the parameters has them."""
        return float(self.items), float(self.accepted), float(self.below_tu1), self.surplus

    @property
    def key(self) -> tuple[str, str]:
        """Product and batch."""
        return self.product, self.batch

    def has_room(self, quota: float) -> bool:
        """Tell whether the next item may be below TU1, of which a share of `quota` may be."""
        return self.below_tu1 + 1 <= quota * (self.accepted + 1) * (1 + ROUNDING)


class BatchRules:
    """The counts of the batches, and the verdicts by the rules over them.

    The counts of a batch only grow. So of what several remember of one batch (`batch_counts` of the
    parameters, the verdicts before a restart) the tally with the most items is the last one, and
    nothing is counted twice.
    """

    def __init__(self) -> None:
        self._tallies: dict[tuple[str, str], BatchTally] = {}
        self._parameters: RejectParameters | None = None

    def remember(self, tally: BatchTally) -> None:
        """Take counts of a batch, unless those that are known are later ones."""
        known = self._tallies.pop(tally.key, tally)
        self._tallies[tally.key] = known if known.items >= tally.items else tally
        if len(self._tallies) > _MAX_TALLIES:
            del self._tallies[next(iter(self._tallies))]

    def judge(self, verdict: Verdict, parameters: RejectParameters, **others: Any) -> Verdict:
        """Return a verdict with the rules applied and with its counts; `others` are set as well."""
        if parameters is not self._parameters:
            self._parameters = parameters
            self.remember(BatchTally.begun(parameters))
        key = parameters.product, parameters.batch
        tally = self._tallies[key]
        decision, reasons = verdict.decision, verdict.reasons
        if decision is Decision.ACCEPT and (
            broken := broken_rules(verdict.mass, tally, parameters)
        ):
            decision, reasons = Decision.UNDER, broken
        tally = count(verdict.mass, tally, parameters, accepted=decision is Decision.ACCEPT)
        self._tallies[key] = tally
        return replace(
            verdict, decision=decision, reasons=reasons, product=tally.product, batch=tally.batch,
            batch_items=tally.items, batch_accepted=tally.accepted,
            batch_below_tu1=tally.below_tu1, batch_surplus=tally.surplus, **others,
        )  # fmt: skip


def broken_rules(mass: float, tally: BatchTally, parameters: RejectParameters) -> tuple[str, ...]:
    """Return the rules that an item of a mass in kg would break if it was accepted."""
    broken = []
    if _below_tu1(mass, parameters) and not tally.has_room(parameters.tu1_quota):
        broken.append(Reason.TU1_QUOTA.value)
    if parameters.mean_value:
        slack = ROUNDING * parameters.nominal
        lacks = mass - parameters.nominal
        if lacks < -slack and tally.surplus + lacks < -slack * (tally.accepted + 1):
            broken.append(Reason.MEAN_VALUE_REQUIREMENT.value)
    return tuple(broken)


def count(
    mass: float, tally: BatchTally, parameters: RejectParameters, *, accepted: bool
) -> BatchTally:
    """Return the tally with one item more."""
    items = tally.items + 1
    if not accepted:
        return replace(tally, items=items)
    surplus = tally.surplus + (mass - parameters.nominal if parameters.nominal else 0.0)
    below_tu1 = tally.below_tu1 + _below_tu1(mass, parameters)
    return BatchTally(*tally.key, items, tally.accepted + 1, below_tu1, surplus)


def _below_tu1(mass: float, parameters: RejectParameters) -> bool:
    return mass < parameters.tu1 * (1 - ROUNDING)

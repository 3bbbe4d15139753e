# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of production for each product and batch, in the time of the samples.

Items that were not accepted are counted by decision and reason. Mean, standard deviation,
giveaway and the shares below TU1 and TU2 are those of the accepted items, which leave the line. All
masses are of the contents, without tare.
"""

from collections import Counter
import math

from checkweigher_core.records import NANOSECONDS, Decision, MassEstimate, Statistics, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.rejection.batch_rules import BatchTally
from checkweigher_dsp.signal.running_moments import RunningMoments
from checkweigher_production.prepackages import ROUNDING
from checkweigher_production.recipes import Product

_MINUTE = 60 * NANOSECONDS
# Such a verdict may come when the next stream has begun.
_OF_STREAM_BEFORE = {Reason.STREAM_ENDED, Reason.SOURCE_RESTARTED}


class ProductionStatistics:
    """Counts, mean and spread of one product in one batch.

    While no product is selected, nominal weight and limits are not known.
    """

    def __init__(self, product: Product | None = None) -> None:
        self.product = product
        self._decisions: Counter[Decision] = Counter()
        self._reasons: Counter[str] = Counter()  # an item may have several
        self._masses = RunningMoments()  # kg, of the accepted items that have one
        self._below_tu1 = self._below_tu2 = 0
        self._length_faults = self._speed_faults = 0
        self._stamp: int | None = None  # the largest t3, ns
        self._first: int | None = None  # t3 since the stream began, ns
        self._last: int | None = None
        self._timed = 0  # since then

    def add(self, verdict: Verdict) -> None:
        """Count one item."""
        self._decisions[verdict.decision] += 1
        self._reasons.update(set(verdict.reasons))
        if verdict.t3 is not None:
            self._stamp = verdict.t3 if self._stamp is None else max(self._stamp, verdict.t3)
            if _OF_STREAM_BEFORE.isdisjoint(verdict.reasons):
                self._add_time(verdict.t3)
        if verdict.decision == Decision.ACCEPT and math.isfinite(verdict.mass):
            self._add_mass(verdict.mass - (self.product.tare if self.product else 0.0))

    def begin_stream(self) -> None:
        """Measure the throughput from now on: a new stream may have another clock."""
        self._first = self._last = None
        self._timed = 0

    def _add_time(self, t3: int) -> None:
        if self._first is None or self._last is None:
            self._first = self._last = t3
        self._first, self._last = min(self._first, t3), max(self._last, t3)
        self._timed += 1

    def _add_mass(self, mass: float) -> None:
        self._masses.add(mass)
        if self.product is not None:
            slack = ROUNDING * self.product.nominal
            self._below_tu1 += mass < self.product.tu1 - slack
            self._below_tu2 += mass < self.product.tu2 - slack

    def add_estimate(self, estimate: MassEstimate) -> bool:
        """Count an item whose length or speed is not that of the product; tell whether it is so."""
        if self.product is None:
            return False
        # A value that is not known is not outside: the item has another reason.
        length = _outside(estimate.product_length, self.product.length)
        speed = _outside(estimate.belt_speed, self.product.speed)
        self._length_faults += length
        self._speed_faults += speed
        return length or speed

    def summary(self, batch: str = '') -> Statistics:
        """Return the counts until now, under the name of a batch."""
        product = self.product or Product('', math.nan)
        mean, count = self._masses.mean, self._masses.count
        return Statistics(
            stamp=self._stamp,
            product=product.name,
            batch=batch,
            items=self._decisions.total(),
            accepted=self._decisions[Decision.ACCEPT],
            under=self._decisions[Decision.UNDER],
            over=self._decisions[Decision.OVER],
            faults=self._decisions[Decision.FAULT],
            reasons=tuple(sorted(self._reasons)),
            reason_counts=tuple(self._reasons[reason] for reason in sorted(self._reasons)),
            length_faults=self._length_faults,
            speed_faults=self._speed_faults,
            nominal=product.nominal,
            tare=product.tare,
            mean=mean,
            std_dev=self._masses.std_dev,
            giveaway=mean - product.nominal,
            tu1=product.tu1,
            tu2=product.tu2,
            below_tu1=self._below_tu1,
            below_tu2=self._below_tu2,
            share_below_tu1=math.nan
            if math.isnan(product.tu1) or not count
            else self._below_tu1 / count,
            throughput=self._throughput(),
            tu1_quota=product.tu1_quota,
            mean_value=product.mean_value,
        )

    def _throughput(self) -> float:
        """Return the items in a minute since the stream began, NaN below two."""
        if self._first is None or self._last is None or self._last == self._first:
            return math.nan
        return (self._timed - 1) * _MINUTE / (self._last - self._first)


class ProductionRecord:
    """The statistics of every product in every batch since the line was started."""

    def __init__(self, batch: str = '') -> None:
        self.batch = batch
        self.product: Product | None = None
        self._all: dict[tuple[str, str], ProductionStatistics] = {}
        self._tallies: dict[tuple[str, str], BatchTally] = {}

    @property
    def _key(self) -> tuple[str, str]:
        return self.product.name if self.product else '', self.batch

    @property
    def current(self) -> ProductionStatistics:
        """The statistics of this product in this batch."""
        found = self._all.get(self._key)
        # The counts of a recipe that was changed begin at 0: its items have other limits.
        if found is None or found.product != self.product:
            found = self._all[self._key] = ProductionStatistics(self.product)
        return found

    def tally(self, product: str, batch: str) -> BatchTally:
        """Return the counts of a product in a batch by the last verdict that had them."""
        return self._tallies.get((product, batch), BatchTally(product, batch))

    def add(self, verdict: Verdict) -> bool:
        """Count an item of the product and batch of its verdict; tell if it was not known yet.

        The number of items in a verdict shows what has been counted: a node that was started again
        gets verdicts that it had before.
        """
        key = verdict.product, verdict.batch
        if verdict.product:
            known = self._tallies.get(key)
            if known is not None and verdict.batch_items <= known.items:
                return False
            self._tallies[key] = BatchTally.of(verdict)
        before = key != self._key and verdict.product
        statistics = self._all.get(key, self.current) if before else self.current
        statistics.add(verdict)
        return True

    def summary(self) -> Statistics:
        """Return the counts of this product in this batch."""
        return self.current.summary(self.batch)

    def has_batch(self, batch: str) -> bool:
        """Tell whether anything was counted for a batch, or it is the present one."""
        return batch == self.batch or any(name == batch for _, name in self._all)

    def begin_stream(self) -> None:
        """Measure the throughput of all products and batches from now on."""
        for each in self._all.values():
            each.begin_stream()

    def reset(self) -> None:
        """Count this product in this batch from 0."""
        self._all[self._key] = ProductionStatistics(self.product)


def _outside(value: float, span: tuple[float, float]) -> bool:
    return value < span[0] or value > span[1]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Production statistics for each product and batch.

All items are counted by decision and reason. Mean, standard deviation, giveaway, and the numbers
below TU1 and TU2 are computed from the accepted items. A mass is the mass of the contents without
tare, in kg. Times are in ns on the clock of the samples.
"""

from collections import Counter, deque
import math
from statistics import median

from checkweigher_core.records import NANOSECONDS, Decision, MassEstimate, Statistics, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.rejection.batch_rules import BatchTally
from checkweigher_dsp.signal.averages import RunningMoments
from checkweigher_production.prepackages import ROUNDING
from checkweigher_production.recipes import Product

_MINUTE = 60 * NANOSECONDS
_LATEST = 25  # number of latest masses whose stated standard deviations are used
_NO_PRODUCT = Product('', math.nan)
# Verdicts with these reasons may belong to the previous stream, so their times do not count for the
# throughput.
_OF_STREAM_BEFORE = {Reason.STREAM_ENDED, Reason.SOURCE_RESTARTED}


class ProductionStatistics:
    """Statistics of one product in one batch, or of items without a product."""

    def __init__(self, product: Product | None = None) -> None:
        self.product = product
        self._decisions: Counter[Decision] = Counter()
        self._reasons: Counter[str] = Counter()
        self._masses = RunningMoments()  # masses of the accepted items in kg
        self._below_tu1 = self._below_tu2 = 0
        self._length_faults = self._speed_faults = 0
        # Largest t3 of the items in ns, or None if no item has a t3.
        self._stamp: int | None = None
        # Smallest and largest t3 in ns, and number of items with a t3, since the stream started.
        self._timed: tuple[int, int, int] | None = None

    def add(self, verdict: Verdict) -> None:
        """Add the verdict on one item to the statistics.

        The mass is used if the item is accepted and the mass is finite.
        """
        self._decisions[verdict.decision] += 1
        self._reasons.update(set(verdict.reasons))
        if verdict.t3 is not None:
            self._stamp = max(self._stamp or verdict.t3, verdict.t3)
            if _OF_STREAM_BEFORE.isdisjoint(verdict.reasons):
                first, last, count = self._timed or (verdict.t3, verdict.t3, 0)
                self._timed = min(first, verdict.t3), max(last, verdict.t3), count + 1
        if verdict.decision == Decision.ACCEPT and math.isfinite(verdict.mass):
            product = self.product or _NO_PRODUCT
            mass, slack = verdict.mass - product.tare, ROUNDING * product.nominal
            self._masses.add(mass)
            self._below_tu1 += mass < product.tu1 - slack
            self._below_tu2 += mass < product.tu2 - slack

    def begin_stream(self) -> None:
        """Restart the measurement of the throughput, because a new stream may use another clock."""
        self._timed = None

    def add_estimate(self, estimate: MassEstimate) -> bool:
        """Count an item if its length or speed is outside the limits of the product.

        Returns True if the item was counted, and False otherwise or without a product.
        """
        if self.product is None:
            return False
        # An unknown value (NaN) counts as within the limits, because such an item already has
        # another fault.
        length = _outside(estimate.product_length, self.product.length)
        speed = _outside(estimate.belt_speed, self.product.speed)
        self._length_faults += length
        self._speed_faults += speed
        return length or speed

    def summary(self, batch: str = '') -> Statistics:
        """Return the statistics of all items so far, with `batch` as the name of their batch."""
        product = self.product or _NO_PRODUCT
        mean, count = self._masses.mean, self._masses.count
        share = math.nan if math.isnan(product.tu1) or not count else self._below_tu1 / count
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
            share_below_tu1=share,
            throughput=self._throughput(),
            tu1_quota=product.tu1_quota,
            mean_value=product.mean_value,
        )

    def _throughput(self) -> float:
        """Return the mean throughput in items per minute since the stream started.

        The result is NaN if fewer than two items have different t3.
        """
        first, last, count = self._timed or (0, 0, 0)
        return math.nan if first == last else (count - 1) * _MINUTE / (last - first)


class ProductionRecord:
    """Statistics of each product in each batch since the start of the line."""

    def __init__(self, batch: str = '') -> None:
        self.batch = batch
        self.product: Product | None = None
        self._all: dict[tuple[str, str], ProductionStatistics] = {}
        self._tallies: dict[tuple[str, str], BatchTally] = {}
        # Item number, t1 and t3 of the last items without a product. The maximum number of items is
        # the history depth of the topic verdict, because a restarted node receives the messages in
        # the history again.
        self._without_product = deque[tuple[int, int | None, int | None]](maxlen=1000)
        self._std_devs = deque[float](maxlen=_LATEST)  # standard deviations of masses, in kg

    @property
    def _key(self) -> tuple[str, str]:
        return self.product.name if self.product else '', self.batch

    @property
    def current(self) -> ProductionStatistics:
        """Statistics of the present product in the present batch."""
        found = self._all.get(self._key)
        # A changed recipe has other limits, so its items are counted from 0.
        if found is None or found.product != self.product:
            found = self._all[self._key] = ProductionStatistics(self.product)
        return found

    def tally(self, product: str, batch: str) -> BatchTally:
        """Return the counts that the last verdict on a product in a batch contains.

        All counts are 0 if there is no such verdict yet.
        """
        return self._tallies.get((product, batch), BatchTally(product, batch))

    def add(self, verdict: Verdict) -> bool:
        """Count an item for the product and batch of its verdict; return whether it was new.

        A restarted node receives verdicts again. A verdict contains the number of items in its
        batch so far. An item is new if this number exceeds the numbers in all earlier verdicts on
        its product and batch. An item without a product is new if no recent item without a product
        has the same item number and times.
        """
        key = verdict.product, verdict.batch if verdict.product else self.batch
        if verdict.product:
            known = self._tallies.get(key)
            if known is not None and verdict.batch_items <= known.items:
                return False
            self._tallies[key] = BatchTally.of(verdict)
        elif (item := (verdict.item_id, verdict.t1, verdict.t3)) in self._without_product:
            return False
        else:
            self._without_product.append(item)
        own = self.current if key == self._key else self._all.get(key)
        if own is None:
            own = self._all[key] = ProductionStatistics()
        own.add(verdict)
        if math.isfinite(verdict.std_dev):
            self._std_devs.append(verdict.std_dev)
        return True

    @property
    def std_dev(self) -> float:
        """Median of the stated standard deviations of the latest masses in kg, or NaN if none."""
        return median(self._std_devs) if self._std_devs else math.nan

    def summary(self) -> Statistics:
        """Return the statistics of the present product in the present batch."""
        return self.current.summary(self.batch)

    def has_batch(self, batch: str) -> bool:
        """Return whether `batch` is the present batch, or a batch that has statistics."""
        return batch == self.batch or any(name == batch for _, name in self._all)

    def begin_stream(self) -> None:
        """Restart the measurement of the throughput of all products and batches."""
        for each in self._all.values():
            each.begin_stream()

    def reset(self) -> None:
        """Reset the statistics of the present product in the present batch to 0 items."""
        self._all[self._key] = ProductionStatistics(self.product)


def _outside(value: float, span: tuple[float, float]) -> bool:
    return value < span[0] or value > span[1]

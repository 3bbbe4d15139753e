"""Statistics of production for each product and batch, in the time of the samples.

Items that were not accepted are counted by decision and reason. Mean, standard deviation,
giveaway and the shares below TU1 and TU2 are those of the accepted items, which leave the line. All
masses are of the contents, without tare.
"""

from collections import Counter
import math

from checkweigher_dsp.production.recipes import Product
from checkweigher_dsp.records import NANOSECONDS, Decision, MassEstimate, Statistics, Verdict

_MINUTE = 60 * NANOSECONDS
# A mass that lies on a limit must not fall below it by a rounding error; far below a load cell.
_ROUNDING = 1e-9


class ProductionStatistics:
    """Counts, mean and spread of one product in one batch.

    Parameters
    ----------
    product : Product or None
        None while none was selected: nominal weight and limits are then not known.

    Attributes
    ----------
    decisions : Counter of Decision
        Items by decision.
    reasons : Counter of str
        Items by reason; an item may have several.
    mean : float
        Of the accepted items, kg; NaN if there is none.
    below_tu1, below_tu2 : int
        Accepted items below each; those below TU2 are below TU1 as well.
    length_faults, speed_faults : int
        Items whose length or belt speed was outside the range of the recipe.
    last : int or None
        Largest t3 so far, ns.
    """

    def __init__(self, product: Product | None = None) -> None:
        self.product = product
        self.decisions: Counter[Decision] = Counter()
        self.reasons: Counter[str] = Counter()
        self.mean = math.nan
        self.below_tu1 = self.below_tu2 = 0
        self.length_faults = self.speed_faults = 0
        self.last: int | None = None
        self._first: int | None = None
        self._timed = 0
        self._squares = 0.0
        self._accepted = 0

    def add(self, verdict: Verdict) -> None:
        """Count one item."""
        self.decisions[verdict.decision] += 1
        self.reasons.update(set(verdict.reasons))
        if verdict.t3 is not None:
            self._timed += 1
            self._first = verdict.t3 if self._first is None else min(self._first, verdict.t3)
            self.last = verdict.t3 if self.last is None else max(self.last, verdict.t3)
        if verdict.decision == Decision.ACCEPT and math.isfinite(verdict.mass):
            self._add_mass(verdict.mass - self.tare)

    def add_estimate(self, estimate: MassEstimate) -> bool:
        """Count an item whose length or speed is not that of the product; tell whether it is so."""
        if self.product is None:
            return False
        # A value that is not known is not outside: the item has another reason.
        length = _outside(estimate.product_length, self.product.length)
        speed = _outside(estimate.belt_speed, self.product.speed)
        self.length_faults += length
        self.speed_faults += speed
        return length or speed

    def _add_mass(self, mass: float) -> None:
        """Update mean and sum of squares as Welford (1962) does: without cancellation."""
        self._accepted += 1
        before = mass if self._accepted == 1 else self.mean
        self.mean = before + (mass - before) / self._accepted
        self._squares += (mass - before) * (mass - self.mean)
        if self.product is not None:
            slack = _ROUNDING * self.product.nominal
            self.below_tu1 += mass < self.product.tu1 - slack
            self.below_tu2 += mass < self.product.tu2 - slack

    def summary(self, batch: str) -> Statistics:
        """Return the counts until now, under the name of a batch."""
        product, decisions = self.product, self.decisions
        return Statistics(
            stamp=self.last,
            product=product.name if product else '',
            batch=batch,
            items=self.items,
            accepted=decisions[Decision.ACCEPT],
            under=decisions[Decision.UNDER],
            over=decisions[Decision.OVER],
            faults=decisions[Decision.FAULT],
            reasons=tuple(sorted(self.reasons)),
            reason_counts=tuple(self.reasons[reason] for reason in sorted(self.reasons)),
            length_faults=self.length_faults,
            speed_faults=self.speed_faults,
            nominal=product.nominal if product else math.nan,
            tare=self.tare,
            mean=self.mean,
            std_dev=self.std_dev,
            giveaway=self.giveaway,
            tu1=product.tu1 if product else math.nan,
            tu2=product.tu2 if product else math.nan,
            below_tu1=self.below_tu1,
            below_tu2=self.below_tu2,
            share_below_tu1=self.share_below_tu1,
            throughput=self.throughput,
        )

    @property
    def tare(self) -> float:
        """Mass of the packaging, kg."""
        return self.product.tare if self.product else 0.0

    @property
    def items(self) -> int:
        """Number of items that passed."""
        return self.decisions.total()

    @property
    def std_dev(self) -> float:
        """Sample standard deviation of the accepted items, kg; NaN below two."""
        many = self._accepted > 1
        return math.sqrt(self._squares / (self._accepted - 1)) if many else math.nan

    @property
    def giveaway(self) -> float:
        """Mean mass of the accepted items above the nominal weight, kg (GiveAway)."""
        return self.mean - self.product.nominal if self.product else math.nan

    @property
    def share_below_tu1(self) -> float:
        """Share of the accepted items below TU1, 0..1; NaN if there is none."""
        known = self.product is not None and not math.isnan(self.product.tu1)
        return self.below_tu1 / self._accepted if self._accepted and known else math.nan

    @property
    def throughput(self) -> float:
        """Items in a minute between the first and the last one, NaN below two."""
        if self._first is None or self.last is None or self.last == self._first:
            return math.nan
        return (self._timed - 1) * _MINUTE / (self.last - self._first)


class ProductionRecord:
    """The statistics of every product in every batch since the line was started."""

    def __init__(self, batch: str = '') -> None:
        self.batch = batch
        self.product: Product | None = None
        self._all: dict[tuple[str, str], ProductionStatistics] = {}

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

    def summary(self) -> Statistics:
        """Return the counts of this product in this batch."""
        return self.current.summary(self.batch)

    def has_batch(self, batch: str) -> bool:
        """Tell whether anything was counted for a batch, or it is the present one."""
        return batch == self.batch or any(name == batch for _, name in self._all)

    def reset(self) -> None:
        """Count this product in this batch from 0."""
        self._all[self._key] = ProductionStatistics(self.product)


def _outside(value: float, span: tuple[float, float]) -> bool:
    return value < span[0] or value > span[1]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The masses in histogram and control chart: those of one product in one batch."""

from dataclasses import dataclass
import math

from checkweigher_dsp.production.control_chart import SUBGROUP
from checkweigher_dsp.records import Decision, Verdict

MAX_MASSES = 500


@dataclass(frozen=True, slots=True)
class MassSeries:
    """Masses of the accepted items since product and batch last changed, the latest of them.

    The subgroups of a control chart are counted from the first item. So of more than `MAX_MASSES` a
    whole subgroup is forgotten at once: an item stays in its own, whatever comes after.

    Attributes
    ----------
    product, batch : str
        Of all of them.
    masses : tuple of float
        In the order in which they came, kg.
    forgotten : int
        Number of the subgroups before.
    """

    product: str = ''
    batch: str = ''
    masses: tuple[float, ...] = ()
    forgotten: int = 0

    def with_item(self, verdict: Verdict) -> 'MassSeries':
        """Return the series with the next item, by its verdict."""
        product, batch, masses, forgotten = (
            verdict.product,
            verdict.batch,
            self.masses,
            self.forgotten,
        )
        if (product, batch) != (self.product, self.batch):
            masses, forgotten = (), 0
        if verdict.decision is Decision.ACCEPT and math.isfinite(verdict.mass):
            masses = *masses, verdict.mass
        if len(masses) >= MAX_MASSES + SUBGROUP:
            masses, forgotten = masses[SUBGROUP:], forgotten + 1
        return MassSeries(product, batch, masses, forgotten)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The masses in histogram and control chart: those of one product in one batch."""

from dataclasses import dataclass, replace
import math

from checkweigher_core.records import Decision, Verdict
from checkweigher_production.control_chart import SUBGROUP

MAX_MASSES = 500


@dataclass(frozen=True, slots=True)
class MassSeries:
    """Masses of the accepted items since product and batch last changed, the latest of them.

    The first item begins the first subgroup of the control chart. A series longer than `MAX_MASSES`
    drops whole subgroups, so each item stays in its subgroup.

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
        same = (verdict.product, verdict.batch) == (self.product, self.batch)
        before = self if same else MassSeries(verdict.product, verdict.batch)
        masses, forgotten = before.masses, before.forgotten
        if verdict.decision is Decision.ACCEPT and math.isfinite(verdict.mass):
            masses = *masses, verdict.mass
        if len(masses) >= MAX_MASSES + SUBGROUP:
            masses, forgotten = masses[SUBGROUP:], forgotten + 1
        return replace(before, masses=masses, forgotten=forgotten)

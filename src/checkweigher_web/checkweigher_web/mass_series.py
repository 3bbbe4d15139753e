# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The masses of one product in one batch, for the histogram and the control charts."""

from dataclasses import dataclass, replace
import math

from checkweigher_core.records import Decision, Verdict
from checkweigher_production.control_chart import SUBGROUP

MAX_MASSES = 500


@dataclass(frozen=True, slots=True)
class MassSeries:
    """The latest masses of the accepted items since the product or the batch last changed.

    The first item of the series begins a subgroup of the control chart. A series that exceeds
    `MAX_MASSES` drops its first subgroup, so that each item stays in its subgroup.

    Attributes
    ----------
    product, batch : str
        Product and batch of the items.
    masses : tuple of float
        Masses in kg, in the order of the items.
    forgotten : int
        Number of subgroups that were dropped.
    """

    product: str = ''
    batch: str = ''
    masses: tuple[float, ...] = ()
    forgotten: int = 0

    def with_item(self, verdict: Verdict) -> 'MassSeries':
        """Return the series with the verdict of the next item."""
        same = (verdict.product, verdict.batch) == (self.product, self.batch)
        before = self if same else MassSeries(verdict.product, verdict.batch)
        masses, forgotten = before.masses, before.forgotten
        if verdict.decision is Decision.ACCEPT and math.isfinite(verdict.mass):
            masses = *masses, verdict.mass
        if len(masses) >= MAX_MASSES + SUBGROUP:
            masses, forgotten = masses[SUBGROUP:], forgotten + 1
        return replace(before, masses=masses, forgotten=forgotten)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Masses of one product in one batch, for the histogram and the control charts."""

from dataclasses import dataclass, replace
import math

from checkweigher_core.records import Decision, Verdict
from checkweigher_production.control_chart import REFERENCE, SUBGROUP

MAX_MASSES = 500


@dataclass(frozen=True, slots=True)
class MassSeries:
    """Latest masses of the accepted items since the last change of product or batch.

    The first item of the series begins a subgroup of the control chart. A series that exceeds
    `MAX_MASSES` by a subgroup drops its first subgroup, so that each item stays in its subgroup.

    Attributes
    ----------
    product, batch : str
        Product and batch of the items.
    masses : tuple of float
        Masses in kg, in the order of the items.
    stamps : tuple of int
        Times of the items in ns, or 0 for an unknown time.
    reference : tuple of float
        First masses in kg since the change of product or batch, which determine the limits of the
        control chart.
    """

    product: str = ''
    batch: str = ''
    masses: tuple[float, ...] = ()
    stamps: tuple[int, ...] = ()
    reference: tuple[float, ...] = ()

    def with_item(self, verdict: Verdict) -> 'MassSeries':
        """Return the series after the next item. Another product or batch begins a new series.

        An item that is not accepted, or that has no mass, adds no mass to the series.
        """
        same = (verdict.product, verdict.batch) == (self.product, self.batch)
        before = self if same else MassSeries(verdict.product, verdict.batch)
        if verdict.decision is not Decision.ACCEPT or not math.isfinite(verdict.mass):
            return before
        masses = *before.masses, verdict.mass
        stamps = *before.stamps, verdict.time or 0
        reference = masses if len(masses) <= REFERENCE else before.reference
        if len(masses) >= MAX_MASSES + SUBGROUP:
            masses, stamps = masses[SUBGROUP:], stamps[SUBGROUP:]
        return replace(before, masses=masses, stamps=stamps, reference=reference)

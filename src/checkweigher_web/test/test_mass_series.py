# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Masses of histogram and control chart: one product and batch, in fixed subgroups."""

from checkweigher_core.records import Decision, Verdict
from checkweigher_production.control_chart import REFERENCE, SUBGROUP
from checkweigher_web.lane import MAX_ITEMS, Lane
from checkweigher_web.mass_series import MAX_MASSES, MassSeries


def verdict(number: int, decision: Decision = Decision.ACCEPT, batch: str = 'L1') -> Verdict:
    """Return the verdict on an item whose mass in kg equals its number."""
    return Verdict(number, number, decision, mass=float(number), product='crisps', batch=batch)


def groups_of(series: MassSeries) -> list[tuple[float, ...]]:
    """Return the masses of each whole subgroup."""
    count = len(series.masses) // SUBGROUP
    return [series.masses[k * SUBGROUP : (k + 1) * SUBGROUP] for k in range(count)]


def test_an_item_stays_in_its_subgroup_however_many_come_after_it():
    lane, groups = Lane(''), set[tuple[float, ...]]()
    for number in range(2 * MAX_MASSES + 3):
        # Rejected items do not shift the subgroups, although they shorten the item list.
        if number % 7 == 0:
            lane.take(verdict(10_000 + number, Decision.UNDER))
        lane.take(verdict(number))
        groups.update(groups_of(lane.series))
    assert len(lane.items()) == MAX_ITEMS
    assert {group[0] % SUBGROUP for group in groups} == {0}
    assert len(groups) == (2 * MAX_MASSES + 3) // SUBGROUP
    assert MAX_MASSES <= len(lane.series.masses) < MAX_MASSES + SUBGROUP
    assert lane.series.stamps == tuple(map(int, lane.series.masses))
    assert lane.series.reference == tuple(map(float, range(REFERENCE)))


def test_another_batch_or_product_begins_anew():
    series = MassSeries()
    for number in range(8):
        series = series.with_item(verdict(number))
    series = series.with_item(verdict(8, Decision.FAULT, 'L2'))
    assert (series.product, series.batch, series.masses) == ('crisps', 'L2', ())
    for number in range(9, 15):
        series = series.with_item(verdict(number, batch='L2'))
    assert groups_of(series) == [(9.0, 10.0, 11.0, 12.0, 13.0)]

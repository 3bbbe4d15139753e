# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Packers' rules and main figures on the page."""

from dataclasses import replace
import math

import pytest

from checkweigher_core.records import Decision, FillerFeedback, ProductOnLine, Verdict
from checkweigher_dsp.rejection.batch_rules import BatchRules
from checkweigher_production.recipes import Product
from checkweigher_production.statistics import ProductionStatistics
from checkweigher_web.history import history_of
from checkweigher_web.lane import ShownItem
from checkweigher_web.views.item import about
from checkweigher_web.views.production import batch_rules, figures, production

PLAIN = Product('crisps', 0.150, tu1=0.14325, tu2=0.1365)
RULED = replace(PLAIN, tu1_quota=0.025, mean_value=True)
RULES = ProductOnLine(
    1, 'crisps', 'L1', nominal=0.150, tu1=0.14325, tu1_quota=0.025, mean_value=True
)


def judged(*masses: float) -> list[Verdict]:
    """Return the verdicts of the reject stage on items with masses in kg."""
    rules = BatchRules()
    items = (Verdict(n, None, Decision.ACCEPT, mass=mass) for n, mass in enumerate(masses, start=1))
    return [rules.judge(item, RULES) for item in items]


def shown(product: Product, verdicts: list[Verdict]) -> list[str]:
    statistics = ProductionStatistics(product)
    for verdict in verdicts:
        statistics.add(verdict)
    found = batch_rules(statistics.summary('L1'), verdicts[-1] if verdicts else None)
    return [text for _, text, _ in found]


def test_the_rules_are_shown_with_how_they_stand():
    verdicts = judged(*[0.152] * 39, 0.140)
    assert verdicts[-1].decision is Decision.ACCEPT
    assert shown(RULED, verdicts) == [
        '✓ 151.700 g of 150.000 g; an item may lack 68.000 g',
        '✓ 1 of 40 accepted, 2.50 % of at most 2.5 %; the next one is rejected, TU1Quota',
        '✓ 0 accepted',
    ]


def test_an_item_that_fits_the_quota_is_announced_and_is_accepted():
    assert shown(RULED, judged(*[0.152] * 39))[1] == (
        '✓ 0 of 39 accepted, 0.00 % of at most 2.5 %; the next one is accepted'
    )
    assert judged(*[0.152] * 38, 0.140)[-1].reasons == ('TU1Quota',)


def test_masses_say_whether_they_have_the_packaging_in_them():
    statistics, verdict = ProductionStatistics(replace(RULED, tare=0.01)), judged(0.161)[0]
    statistics.add(verdict)
    found = dict(production(statistics.summary(), None))
    assert (found['net mean, g'], found['giveaway, g']) == ('151.000', '1.000')
    assert about(ShownItem(verdict)) == 'item 1, gross, no limits'
    limited = replace(verdict, lower_limit=0.15)
    assert about(ShownItem(limited)) == 'item 1, gross'
    assert about(ShownItem(replace(limited, mass=math.nan))) == 'item 1'


def test_a_recipe_without_the_rules_shows_what_came():
    accepted = [Verdict(n, None, Decision.ACCEPT, mass=0.11 + 0.02 * n) for n in (1, 2)]
    assert shown(PLAIN, accepted) == [
        'not asked by the recipe; the mean is 140.000 g',
        'not asked by the recipe; 1 accepted, 50.00 %', '✗ 1 accepted',
    ]  # fmt: skip


def test_counts_of_another_batch_are_none_of_this_one():
    statistics = ProductionStatistics(RULED).summary('L2')
    found = batch_rules(statistics, judged(0.152)[-1])
    assert found[0] == ('net mean at least nominal', 'nothing accepted yet', None)
    assert batch_rules(None, None) == []
    assert batch_rules(ProductionStatistics().summary(), None) == []


def test_the_correction_of_the_filler_is_shown_for_the_product_that_it_is_of():
    statistics = ProductionStatistics(PLAIN).summary('L1')
    told = FillerFeedback(1, 'crisps', 10, 10, 0.150, 0.147, 0.0015, 0.0025)
    name = 'filler correction, g'
    assert dict(production(statistics, told))[name] == '+2.500, at a median of 147.000'
    limited = replace(told, correction=-0.004, limited=True)
    assert dict(production(statistics, limited))[name] == '-4.000, at a median of 147.000; limited'
    assert name not in dict(production(statistics, None))
    assert name not in dict(production(statistics, replace(told, product='nuts')))


def test_a_bar_is_full_where_a_rule_leaves_nothing_more():
    def used(product: Product, *masses: float) -> list[float | None]:
        statistics = ProductionStatistics(product)
        verdicts = judged(*masses)
        for verdict in verdicts:
            statistics.add(verdict)
        return [each for *_, each in batch_rules(statistics.summary('L1'), verdicts[-1])]

    # TU1 is 6.75 g below the nominal mass, the mean is 1.7 g above it, and the quota is 2.5 %.
    assert used(RULED, *[0.152] * 39, 0.140) == [pytest.approx(1 - 1.7 / 6.75), pytest.approx(1), 0]
    assert used(RULED, 0.150) == [pytest.approx(1), 0, 0]
    assert used(PLAIN, 0.150) == [None, None, 0]
    light = ProductionStatistics(PLAIN)
    light.add(Verdict(1, None, Decision.ACCEPT, mass=0.130))
    *_, below = batch_rules(light.summary(), None)
    assert below[-1] > 1


def test_figures_have_the_last_minute_and_their_course():
    second = 1_000_000_000
    items = [
        (Verdict(n, n * second, Decision.UNDER if n % 4 == 0 else Decision.ACCEPT, mass=0.152), 0.0)
        for n in range(1, 181)
    ]
    statistics = ProductionStatistics(PLAIN)
    for verdict, _ in items:
        statistics.add(verdict)
    found = figures(history_of(items), statistics.summary(), 180 * second)
    assert [(name, text) for name, text, _ in found] == [
        ('items/min, last minute', '60'), ('rejected', '25.0 %'), ('giveaway', '2.00 g'),
        ('net mean', '152.00 g'),
    ]  # fmt: skip
    assert len(found[0][2].split()) == 17  # intervals of 10 s

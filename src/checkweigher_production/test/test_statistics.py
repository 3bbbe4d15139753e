# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of production against numbers worked by hand and against the statistics module."""

from dataclasses import replace
from itertools import count
import math
import statistics

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_core.records import NANOSECONDS, Decision, MassEstimate, Verdict
from checkweigher_core.settings_files import settings_of
from checkweigher_production.recipes import Product
from checkweigher_production.statistics import ProductionRecord, ProductionStatistics

EXACT = 1e-12  # relative
START = 1_700_000_000 * NANOSECONDS
NUMBERS = count(1)  # of the items


@pytest.fixture(name='crisps')
def _crisps() -> Product:
    """150 g: TU1 143.25 g, TU2 136.5 g."""
    return settings_of(Product, {'nominal': 0.15, 'tare': 0.004, 'length': [0.1, 0.2]}, 'crisps')


def verdict(mass: float, decision: Decision = Decision.ACCEPT, **others: object) -> Verdict:
    return Verdict(next(NUMBERS), others.pop('t3', None), decision, mass=mass, **others)


def test_mean_giveaway_and_shares_are_those_of_the_contents_of_what_was_accepted(crisps: Product):
    counted = ProductionStatistics(crisps)
    # Gross; the packaging weighs 4 g. Contents 151, 154, 143.25 (not below TU1), 143, 136 g.
    for mass in (0.155, 0.158, 0.14725, 0.147, 0.14):
        counted.add(verdict(mass))
    counted.add(verdict(0.2, Decision.OVER))
    counted.add(verdict(0.1, Decision.UNDER))
    counted.add(verdict(math.nan, Decision.FAULT, reasons=('SamplesLost', 'Saturation')))
    counted.add(verdict(math.nan, Decision.FAULT, reasons=('SamplesLost',)))
    found = counted.summary()
    # (151 + 154 + 143.25 + 143 + 136) / 5 = 145.45
    assert found.mean == pytest.approx(0.14545, rel=EXACT)
    assert found.giveaway == pytest.approx(-0.00455, rel=1e-10)
    # Squares of 5.55, 8.55, -2.2, -2.45, -9.45: 204.05 over 4
    assert found.std_dev == pytest.approx(math.sqrt(204.05 / 4) * 1e-3, rel=1e-10)
    assert (found.below_tu1, found.below_tu2) == (2, 1)
    assert found.share_below_tu1 == 0.4
    assert found.items == 9
    assert (found.accepted, found.over, found.under, found.faults) == (5, 1, 1, 2)
    assert found.reasons == ('SamplesLost', 'Saturation')
    assert found.reason_counts == (2, 1)


def test_before_anything_passed_nothing_is_known(crisps: Product):
    counted = ProductionStatistics(crisps).summary()
    assert all(map(math.isnan, (counted.mean, counted.share_below_tu1, counted.throughput)))
    assert counted.items == 0


def test_without_a_product_there_is_a_mean_but_no_giveaway():
    counted = ProductionStatistics()
    counted.add(verdict(0.2))
    found = counted.summary()
    assert found.mean == 0.2
    assert math.isnan(found.std_dev)
    assert math.isnan(found.giveaway)
    assert math.isnan(found.share_below_tu1)


@given(
    st.lists(st.floats(-1e-3, 1e-3), min_size=2, max_size=50), st.sampled_from([0.0, 0.1, 1000.0])
)
def test_the_spread_does_not_suffer_from_a_large_mean(deviations: list[float], mean: float):
    masses = [mean + each for each in deviations]
    counted = ProductionStatistics()
    for mass in masses:
        counted.add(verdict(mass))
    found = counted.summary()
    assert found.mean == pytest.approx(statistics.fmean(masses), rel=1e-12, abs=1e-15)
    assert found.std_dev == pytest.approx(statistics.stdev(masses), rel=1e-6, abs=1e-12)


def test_throughput_counts_the_distances_between_items_in_the_time_of_the_samples():
    counted = ProductionStatistics()
    # Four distances of 0.6 s are 100 items in a minute, in any order.
    for number in (0, 2, 1, 4, 3):
        counted.add(verdict(0.1, t3=START + number * 6 * NANOSECONDS // 10))
    counted.add(verdict(math.nan, Decision.FAULT, t3=None))
    assert counted.summary().throughput == pytest.approx(100.0, rel=EXACT)


@pytest.mark.parametrize('later', [-3600, 0, 5, 3600])
def test_the_throughput_is_that_of_the_stream_whatever_its_clock(later: int):
    record = ProductionRecord()
    for number in range(20):
        record.add(verdict(0.1, t3=START + number * 6 * NANOSECONDS // 10))
    record.begin_stream()
    assert math.isnan(record.summary().throughput)
    # The last item of the stream before is told of when the next one has begun.
    ended = ('StreamEnded',)
    record.add(replace(verdict(math.nan, Decision.FAULT, t3=START), reasons=ended))
    for number in range(5):
        record.add(verdict(0.1, t3=START + later * NANOSECONDS + number * NANOSECONDS))
    found = record.summary()
    assert found.throughput == pytest.approx(60.0, rel=EXACT)
    assert found.items == 26


def test_an_item_of_another_length_is_counted_and_one_of_unknown_length_is_not(crisps: Product):
    counted = ProductionStatistics(crisps)
    for length in (0.1, 0.2, 0.21, 0.05, math.nan):
        counted.add_estimate(MassEstimate(1, 1, 2, 3, product_length=length, belt_speed=1.0))
    found = counted.summary()
    assert (found.length_faults, found.speed_faults) == (2, 0)


def test_each_product_and_batch_has_its_own_count(crisps: Product):
    record = ProductionRecord('monday')
    record.add(verdict(0.15))
    record.product = crisps
    of_crisps = [verdict(0.154, product='crisps', batch='monday', batch_items=n) for n in (1, 2)]
    assert [record.add(each) for each in (*of_crisps, of_crisps[1])] == [True, True, False]
    # While no product is on the line, items belong to none, whichever was the last one.
    record.add(verdict(0.1, Decision.FAULT, reasons=('NoProduct',)))
    assert (record.summary().items, record.summary().faults) == (2, 0)
    record.batch = 'tuesday'
    assert record.summary().items == 0
    record.batch = 'monday'
    record.reset()
    assert record.summary().items == 0
    record.product = None
    assert record.summary().items == 2
    assert record.has_batch('monday')
    assert not record.has_batch('wednesday')


def test_a_recipe_that_was_changed_counts_anew(crisps: Product):
    record = ProductionRecord()
    record.product = crisps
    record.current.add(verdict(0.154))
    record.product = settings_of(Product, {'nominal': 0.16}, 'crisps')
    assert record.summary().items == 0

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Giveaway over the night of a change to summer time, against numpy."""

from datetime import datetime
from datetime import time as time_of_day
from functools import partial
import time
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from checkweigher_core.records import Decision
from checkweigher_production.recipes import Product
from checkweigher_validation.batch.batch import Batch, BatchItem, Part
from checkweigher_validation.batch.giveaway import day, giveaway, month, shift

BERLIN = ZoneInfo('Europe/Berlin')
BEGINS = [time_of_day(6), time_of_day(22)]


@pytest.fixture(autouse=True)
def _berlin(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('TZ', 'Europe/Berlin')
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def stamp(*when: int) -> int:
    return int(datetime(*when, tzinfo=BERLIN).timestamp()) * 1_000_000_000


def test_kg_and_money_by_shift_day_and_month():
    random = np.random.default_rng(1)
    # The clocks go from 02:00 to 03:00 on 29 March 2026.
    days = (28, 23, 0), (29, 5, 59), (29, 6, 0), (31, 22, 0)
    times = [*(stamp(2026, 3, *each) for each in days), stamp(2026, 4, 1, 0, 30)]
    masses = random.normal(0.152, 0.002, (5, 100))
    items = [
        BatchItem(Decision.ACCEPT, (), mass, when)
        for when, own in zip(times, masses, strict=True)
        for mass in own
    ]
    items.append(BatchItem(Decision.UNDER, (), 0.1, times[0]))
    batch = Batch('L1', 'L1.jsonl', (Part(Product('crisps', 0.15, price=4.0), tuple(items)),))
    for period, wanted in (
        (
            partial(shift, begins=BEGINS),
            {'2026-03-28 22:00': [0, 1], '2026-03-29 06:00': [2], '2026-03-31 22:00': [3, 4]},
        ),
        (day, {'2026-03-28': [0], '2026-03-29': [1, 2], '2026-03-31': [3], '2026-04-01': [4]}),
        (month, {'2026-03': [0, 1, 2, 3], '2026-04': [4]}),
    ):
        found = giveaway([batch], period)
        assert [each.period for each in found] == list(wanted)
        for each in found:
            surplus = np.sum(masses[wanted[each.period]] - 0.15)
            assert each.items == 100 * len(wanted[each.period])
            assert each.surplus == pytest.approx(surplus, rel=1e-12)
            assert each.money == pytest.approx(4 * surplus, rel=1e-12)
    assert giveaway([batch], month, price=1.0)[0].money == pytest.approx(np.sum(masses[:4] - 0.15))

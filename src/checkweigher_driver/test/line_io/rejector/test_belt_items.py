# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is known of the items between the infeed eye and the rejector."""

import time

import pytest

from checkweigher_core.records import Decision, Eye, EyeEdge, Item, Verdict
from checkweigher_driver.line_io.rejector.belt_items import BeltItems

MS = 1_000_000
T1 = 1_700_000_000_500_000_000


@pytest.fixture(autouse=True)
def _utc(monkeypatch):
    monkeypatch.setenv('TZ', 'UTC')
    time.tzset()


def entered(*stamps):
    """Return items of 100 ms that have entered."""
    items = BeltItems()
    for stamp in stamps:
        items.edge(EyeEdge(stamp, Eye.INFEED, True))
        items.edge(EyeEdge(stamp + 100 * MS, Eye.INFEED, False))
    return items


def verdict(number, t1, decision=Decision.UNDER):
    return Verdict(number, None, decision, t1=t1)


def test_an_item_is_named_by_its_number_decision_and_time():
    items = entered(T1, T1 + 1000 * MS)
    item = items.judge(verdict(7, T1), 500)
    assert item.passage == 100 * MS
    assert items.names()[0] == 'item 7 UNDER (entered 22:13:20.5)'


def test_an_announced_item_has_its_number_without_a_verdict():
    items = entered(T1, T1 + 1000 * MS)
    items.announce(Item(T1, 1, 7, t1=T1, t2=T1 + 120 * MS))
    assert items.names() == (
        'item 7 without a verdict (entered 22:13:20.5)',
        'a product without a verdict (entered 22:13:21.5)',
    )
    assert items.judge(verdict(7, T1), 500).passage == 120 * MS


def test_an_announcement_of_an_item_that_has_a_verdict_or_was_not_seen_is_dropped():
    items = entered(T1)
    items.judge(verdict(1001, T1, Decision.FAULT), 500)
    items.announce(Item(T1, 1, 8, t1=T1))
    items.announce(Item(T1 + 300 * MS, 1, 9, t1=T1 + 300 * MS))
    items.announce(Item(T1 + 300 * MS, 1, 10, t3=T1 + 300 * MS))
    assert items.names() == ('item 1001 FAULT (entered 22:13:20.5)',)


def test_what_has_passed_the_rejector_is_gone_with_all_in_front_of_it():
    items = entered(T1, T1 + 1000 * MS, T1 + 2000 * MS)
    items.judge(verdict(2, T1 + 1000 * MS), 500)
    items.leave(499)
    assert len(items.names()) == 3
    items.leave(500)
    assert [item.entered for item in items] == [T1 + 2000 * MS]


def test_an_item_whose_entry_nobody_saw_takes_none_with_it():
    items = entered(T1)
    items.judge(verdict(2, None), 500)
    items.leave(500)
    assert [item.entered for item in items] == [T1]


def test_one_whose_place_is_not_known_is_forgotten_once_it_is_told():
    items = entered(T1)
    assert items.judge(verdict(1, T1), None).number == 1
    assert not items


def test_a_flicker_is_no_second_product():
    items = entered(T1, T1 + 105 * MS)
    assert len(items.names()) == 1
    assert items.judge(verdict(1, T1), 500).passage == 205 * MS


def test_many_items_are_counted():
    items = entered(*(T1 + number * 1000 * MS for number in range(13)))
    assert items.names()[-1] == '3 more'
    assert len(items.names()) == 11

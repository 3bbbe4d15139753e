# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How long items take, and which of those on the belt an edge can be of."""

from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.belt import Belt, UsualTransit
from checkweigher_dsp.items.departures import take_leaving
from checkweigher_dsp.items.eyes import Eyes
from checkweigher_dsp.items.item import State, TrackedItem

MAX_TRANSIT = 2000


def _belt(*entries, transit=100):
    """Return a belt with items that entered then, each 10 long."""
    usual = UsualTransit(MAX_TRANSIT, 0.0)
    usual.value = transit
    belt = Belt(Eyes(5, MAX_TRANSIT), usual, 0)
    for t1 in entries:
        item = belt.new_item()
        item.t1, item.t2 = t1, t1 + 10
        belt.items.append(item)
    return belt


def _learned(*transits):
    usual, outliers = UsualTransit(MAX_TRANSIT, 0.0), []
    for transit in transits:
        item = TrackedItem(1)
        usual.learn(item, transit)
        outliers.append(item.outlier)
    return usual.value, outliers


def test_a_transit_far_off_is_believed_when_the_next_one_agrees():
    assert _learned(100, 140, 130) == (130, [False, False, False])
    assert _learned(100, 160, 100) == (100, [False, True, False])
    assert _learned(100, 160, 170) == (170, [False, True, False])


def test_before_a_whole_item_the_length_of_the_product_gives_the_transit():
    usual = UsualTransit(MAX_TRANSIT, 2.0)

    assert usual.of(TrackedItem(1, t1=0, t2=50)) == 100
    assert usual.of(TrackedItem(1, t1=0, t2=1500)) == MAX_TRANSIT
    assert usual.of(TrackedItem(1, t1=0)) is None


def test_the_item_nearest_to_its_time_leaves_and_those_before_it_are_given_up():
    belt = _belt(0, 30, 60)

    assert take_leaving(belt, 132).t1 == 30
    assert [item.t1 for item in belt.items] == [60]
    (missed,) = belt.take_finished()
    assert (missed.t1, missed.state) == (0, State.GIVEN_UP)
    assert list(missed.faults) == [Reason.MISSING_EDGE]

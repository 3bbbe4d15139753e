# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is known of an item with some of its edges."""

import pytest

from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.item import State, TrackedItem


@pytest.mark.parametrize(
    ('stamps', 'given_up', 'departure'),
    [
        ({'t1': 100, 't2': 130, 't3': 200, 't4': 230}, None, 230),
        ({'t1': 100, 't2': 130, 't3': 200}, None, 260),  # t4 was lost: twice its length
        ({'t1': 100, 't2': 130}, 400, 400),  # until then it may have been there
        ({'t1': 100, 't2': 450}, 400, 450),
        ({'t3': 200}, None, 200),
    ],
)
def test_an_item_is_gone_at_t4_or_when_it_must_be(stamps, given_up, departure):
    assert TrackedItem(1, **stamps, given_up=given_up).departure == departure


@pytest.mark.parametrize(
    ('item', 'first', 'last'),
    [
        (TrackedItem(1, t1=100, t2=130), 100, 135),
        (TrackedItem(1, t1=100), 100, 105),
        (TrackedItem(1, t2=130, t3=200), 0, 129),  # its t1 was lost
        (TrackedItem(1, t1=100, faults={Reason.CHATTERING_EYE: None}), 100, 10_000),
    ],
)
def test_an_item_accounts_for_a_blocked_infeed_eye_while_it_is_there(item, first, last):
    assert item.accounts_for(first, 5)
    assert item.accounts_for(last, 5)
    assert not item.accounts_for(first - 1, 5) or first == 0
    assert not item.accounts_for(last + 1, 5) or last == 10_000


def test_a_snapshot_does_not_change_with_its_item():
    item = TrackedItem(1, t1=100)
    item.fault(Reason.MISSING_EDGE)
    taken = item.snapshot()

    item.fault(Reason.LATE_EDGE, Reason.MISSING_EDGE)
    item.t2, item.state = 130, State.GONE

    assert (taken.t2, list(taken.faults)) == (None, [Reason.MISSING_EDGE])
    assert taken.state is State.ON_BELT
    assert list(item.faults) == [Reason.MISSING_EDGE, Reason.LATE_EDGE]

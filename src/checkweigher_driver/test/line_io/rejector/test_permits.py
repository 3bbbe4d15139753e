# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Permissions on the time of a belt, without a port."""

import math

from checkweigher_driver.line_io.rejector.permits import Permits
from checkweigher_driver.line_io.rejector.reject_pulses import BeltTime

MS = 1_000_000


def permits(margin=20, pause=10):
    belt = BeltTime()
    return Permits(belt, margin * MS, pause * MS), belt


def on(made, until=2000):
    """Return the ms at which something may pass."""
    return [now for now in range(0, until, 10) if made.given(now * MS)]


def test_a_permit_lasts_while_its_item_is_at_the_rejector():
    made, _ = permits()
    assert made.permit(500 * MS, 200 * MS, 0)
    assert made.next_change(0) == 480 * MS
    assert made.next_change(490 * MS) == 720 * MS
    assert on(made) == list(range(480, 720, 10))
    assert made.next_change(720 * MS) == math.inf


def test_an_item_that_is_at_the_rejector_already_is_not_permitted():
    made, _ = permits()
    assert not made.permit(500 * MS, 200 * MS, 501 * MS)
    assert on(made) == []


def test_a_permit_that_nobody_asked_for_in_time_is_not_given():
    made, _ = permits()
    made.permit(500 * MS, 200 * MS, 0)
    assert not made.given(530 * MS)
    assert not made.given(540 * MS)
    assert made.next_change(540 * MS) == math.inf


def test_no_two_permits_touch_and_a_rejected_item_does_not_pass_with_the_one_before_it():
    made, _ = permits()
    made.permit(720 * MS, 200 * MS, 0)
    made.permit(500 * MS, 200 * MS, 0)  # in whichever order the verdicts come
    made.deny(930 * MS)
    assert on(made) == [*range(480, 690, 10), *range(700, 920, 10)]


def test_a_permit_waits_for_a_belt_that_stands_and_is_withdrawn_by_clear():
    made, belt = permits()
    made.permit(500 * MS, 100 * MS, 0)
    belt.stop(300 * MS)
    assert made.next_change(400 * MS) == math.inf
    belt.run(1000 * MS)
    assert made.next_change(1000 * MS) == 1180 * MS
    assert made.given(1200 * MS)
    made.clear()
    assert not made.given(1210 * MS)

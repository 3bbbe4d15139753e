# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the eyes have shown: chatter, edges that come twice, states at start-up."""

import pytest

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_dsp.items.eyes import Eyes, Switch

DEBOUNCE, MAX_TRANSIT = 5, 2000


@pytest.mark.parametrize(
    ('blocked_before', 'delay', 'flickers'),
    [(False, 4, True), (False, 5, False), (True, 9, True), (True, 10, False), (True, -1, False)],
)
def test_an_edge_too_soon_is_chatter_twice_as_long_if_one_was_lost(blocked_before, delay, flickers):
    switch = Switch(100 + delay, EyeEdge(100, Eye.INFEED, blocked_before), None, True)

    assert Eyes(DEBOUNCE, MAX_TRANSIT).flickers(switch) == flickers


def test_the_first_edge_of_all_is_no_chatter():
    assert not Eyes(DEBOUNCE, MAX_TRANSIT).flickers(Switch(100, None, None, True))


def test_an_edge_that_comes_twice_is_recognized_among_the_latest():
    eyes, first = Eyes(DEBOUNCE, MAX_TRANSIT), EyeEdge(0, Eye.INFEED, True)

    assert [eyes.is_new(first), eyes.is_new(first)] == [True, False]
    assert all(eyes.is_new(EyeEdge(stamp, Eye.INFEED, True)) for stamp in range(1, 65))
    assert eyes.is_new(first)


@pytest.mark.parametrize(
    ('origin', 'stamp', 'state'),
    [
        (None, 100, False),
        (100, 105, True),
        (100, 106, False),
        (1000, 100, True),
        (2100, 100, False),
    ],
)
def test_an_eye_shows_its_state_with_the_first_sample(origin, stamp, state):
    eyes = Eyes(DEBOUNCE, MAX_TRANSIT)
    eyes.origin = origin

    assert eyes.shows_state(stamp) == state


@pytest.mark.parametrize(('delay', 'state'), [(5, True), (6, False)])
def test_or_together_with_the_other_eye(delay, state):
    eyes = Eyes(DEBOUNCE, MAX_TRANSIT)
    eyes.take(EyeEdge(100, Eye.INFEED, False))
    eyes.take(EyeEdge(100 + delay, Eye.OUTFEED, False))

    assert eyes.shows_state(100) == state


def test_by_another_clock_an_edge_is_new_and_no_chatter():
    eyes, edge = Eyes(DEBOUNCE, MAX_TRANSIT), EyeEdge(100, Eye.INFEED, True)
    eyes.is_new(edge)
    eyes.take(edge)

    eyes.forget_clock()

    assert eyes.is_new(edge)
    assert eyes.any_blocked
    assert not eyes.flickers(Switch(101, eyes.take(EyeEdge(101, Eye.INFEED, False)), None, False))

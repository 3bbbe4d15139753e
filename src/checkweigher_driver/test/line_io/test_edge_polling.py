# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges from polls: always within the stated uncertainty, never invented."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_driver.line_io.edge_polling import EdgePolling, Poll
from checkweigher_driver.sources import EyesBack, EyesLost

CLEAR = (False, False)


def polling(max_uncertainty=1000, longest_gap=5000, delay=0):
    """Return the polling of eyes that were clear at 0..10."""
    found = EdgePolling(max_uncertainty, longest_gap, delay)
    assert found.add(Poll(0, 10, CLEAR), 0) == []
    return found


def test_an_edge_is_in_the_middle_of_what_two_polls_leave_open():
    found = polling()
    assert found.add(Poll(100, 130, (True, False)), 0) == [EyeEdge(65, Eye.INFEED, True)]
    assert found.add(Poll(200, 210, (False, True)), 7000) == [
        EyeEdge(7155, Eye.INFEED, False),
        EyeEdge(7155, Eye.OUTFEED, True),
    ]
    assert found.figures()['largest edge uncertainty ms'] == pytest.approx(65e-6)
    late = polling(delay=40)
    assert late.add(Poll(100, 130, (True, False)), 0) == [EyeEdge(25, Eye.INFEED, True)]


def test_an_edge_that_is_too_uncertain_is_none():
    found = polling(max_uncertainty=50)
    lost, back = found.add(Poll(100, 130, (True, False)), 0)
    assert isinstance(lost, EyesLost)
    assert lost.stamp == 0
    assert '0.0 ms' in lost.text
    assert back == EyesBack(130)
    assert found.losses == 1
    # From then on it is the known state.
    assert found.add(Poll(140, 150, (False, False)), 0) == [EyeEdge(125, Eye.INFEED, False)]


def test_without_a_change_a_short_gap_is_no_loss_and_a_long_one_is():
    found = polling(max_uncertainty=50, longest_gap=500)
    assert found.add(Poll(400, 410, CLEAR), 0) == []
    lost, back = found.add(Poll(900, 910, CLEAR), 0)
    assert (lost.stamp, back.stamp) == (400, 910)


def test_a_gap_in_which_a_product_like_the_last_one_may_have_passed_is_a_loss():
    found = polling(max_uncertainty=50, longest_gap=5000)
    blocked = (True, False)
    for begin, state in ((90, blocked), (180, blocked), (270, blocked), (360, CLEAR)):
        found.add(Poll(begin, begin + 10, state), 0)
    assert found.losses == 0  # it was 270 at the eye
    assert found.add(Poll(620, 630, CLEAR), 0) == []
    lost, back = found.add(Poll(890, 900, CLEAR), 0)
    assert (lost.stamp, back.stamp) == (620, 900)
    # An eye that chatters leaves as much as an edge may be uncertain.
    for begin, state in ((905, CLEAR), (910, blocked), (915, CLEAR), (1010, CLEAR)):
        found.add(Poll(begin, begin + 1, state), 0)
    assert found.losses == 1


def test_a_loss_is_said_once_and_the_state_that_is_found_then_is_no_edge():
    found = polling()
    assert found.lose(50, 0, 'cable') == [EyesLost(0, 'cable')]
    assert found.lose(90, 0, 'cable') == []
    assert found.add(Poll(700, 710, (True, True)), 0) == [EyesBack(710)]
    assert found.add(Poll(720, 730, (True, False)), 0) == [EyeEdge(715, Eye.OUTFEED, False)]


def test_eyes_that_are_not_there_at_the_start_are_lost_from_then_on():
    found = EdgePolling(1000, 5000, 0)
    assert found.lose(50, 1000, 'no answer') == [EyesLost(1050, 'no answer')]


@given(
    st.lists(st.tuples(st.integers(0, 40), st.integers(1, 30)), min_size=2, max_size=60),
    st.lists(st.integers(0, 2000), max_size=10, unique=True),
    st.randoms(use_true_random=False),
)
def test_no_edge_is_further_from_the_truth_than_stated(waits, switches, random):
    """An eye that switches at known times, read at a random moment of each poll."""
    found, now, truth, taken = EdgePolling(10**6, 10**6, 0), 0, sorted(switches), []
    last_read, last_begin = -1, 0
    for wait, length in waits:
        begin = now + wait
        moment = random.randint(begin, begin + length)
        blocked = sum(time <= moment for time in truth) % 2 == 1
        for edge in found.add(Poll(begin, begin + length, (blocked, False)), 0):
            between = [time for time in truth if last_read < time <= moment]
            stated = (begin + length - last_begin) // 2
            assert min(abs(edge.stamp - time) for time in between) <= stated + 1
            taken.append(edge)
        last_read, last_begin, now = moment, begin, begin + length
    assert [edge.blocked for edge in taken] == [
        taken[0].blocked ^ (number % 2 == 1) for number in range(len(taken))
    ]

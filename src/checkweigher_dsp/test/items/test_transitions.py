# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The transition table of item tracking against what really happens to items."""

from collections import Counter
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items import transitions
from checkweigher_dsp.items.belt import Belt, UsualTransit
from checkweigher_dsp.items.eyes import Eyes
from checkweigher_dsp.items.item import State, TrackedItem
from checkweigher_dsp.items.tracking import ItemTracker

MS = 1_000_000
DEBOUNCE = 5 * MS
MAX_TRANSIT = 2000 * MS
CASES = [case for cases in transitions.TRANSITIONS.values() for case in cases]


def _faults(belt, *others):
    known = [*belt.items, *belt.given_up, *belt.abandoned, belt.left_last, belt.begun, *others]
    return {(item.item_id, reason) for item in known if item is not None for reason in item.faults}


def _watched(case, taken):
    """Return a case that counts when it holds and checks that its action does as the table."""

    def action(belt, switch):
        before = _faults(belt)
        item = case.action(belt, switch)
        others = [item] if isinstance(item, TrackedItem) else []
        new = {reason for _, reason in _faults(belt, *others) - before}
        taken[case.action.__name__] += bool(item)
        assert new <= (set(case.reasons) if item else set())
        assert not item or isinstance(item, TrackedItem) or case.state is None
        return item

    return replace(case, action=action)


@pytest.fixture
def taken(monkeypatch):
    counts = Counter()
    for key, cases in transitions.TRANSITIONS.items():
        watched = tuple(_watched(case, counts) for case in cases)
        monkeypatch.setitem(transitions.TRANSITIONS, key, watched)
    return counts


STEPS = st.lists(
    st.tuples(
        st.sampled_from([1, 2, 4, 20, 50, 100, 100, 200, 500, 2500]),
        st.sampled_from(list(Eye)),
        st.booleans(),
    ),
    min_size=4,
    max_size=40,
)


def test_each_case_is_met_and_gives_no_other_reasons_than_the_table_says(taken):
    @settings(max_examples=500)
    @given(STEPS)
    def check(steps):
        tracker, stamp = ItemTracker(DEBOUNCE, MAX_TRANSIT), 0
        for number, (delay, eye, blocked) in enumerate(steps):
            stamp += delay * MS
            tracker.add(EyeEdge(stamp, eye, blocked))
            if number == 20:
                tracker.give_up(Reason.CLOCK_JUMP)
                tracker.forget(backwards=False)

    check()

    assert set(+taken) == {case.action.__name__ for case in CASES}


def _states(*edges):
    """Return the states of an item after each of its edges, (ms, eye, blocked)."""
    belt, states = Belt(Eyes(DEBOUNCE, MAX_TRANSIT), UsualTransit(MAX_TRANSIT, 0.0), 0), []
    for ms, eye, blocked in edges:
        transitions.apply_edge(belt, EyeEdge(ms * MS, eye, blocked))
        states.append(belt.begun.state)
    belt.abandon(Reason.STREAM_ENDED)
    return [*states, belt.begun.state]


T1, T2 = (1000, Eye.INFEED, True), (1100, Eye.INFEED, False)
T3, T4 = (1200, Eye.OUTFEED, True), (1300, Eye.OUTFEED, False)


@pytest.mark.parametrize(
    ('edges', 'states'),
    [
        ([T1, T2, T3, T4], [State.ENTERING, State.ON_BELT, State.LEAVING, State.GONE, State.GONE]),
        ([T1, T2, T4], [State.ENTERING, State.ON_BELT, State.GIVEN_UP, State.GIVEN_UP]),
        ([T1, T2], [State.ENTERING, State.ON_BELT, State.ABANDONED]),
    ],
)
def test_an_item_has_a_state_after_each_edge_and_at_the_end_of_the_stream(edges, states):
    assert _states(*edges) == states

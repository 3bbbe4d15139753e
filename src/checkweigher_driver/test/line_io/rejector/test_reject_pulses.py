# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pulses of the rejector, also while the belt stands."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_driver.line_io.rejector.reject_pulses import BeltTime, PulseTimes, RejectPulses


def pulses(duration=100, min_pause=20, late_tolerance=10, belt_margin=0):
    times = PulseTimes(duration, min_pause, late_tolerance, belt_margin)
    return RejectPulses(times, BeltTime())


def run(schedule, now):
    """Start the belt again, as the outputs do."""
    schedule.resume(schedule.belt.run(now))


def changes(schedule, now, end):
    """Return when the rejector switches from `now` to `end`, as a thread does that waits."""
    found = []
    acting = False
    while now <= end:
        if schedule.acting(now) != acting:
            acting = not acting
            found.append(now)
        following = schedule.next_change(now)
        assert following > now
        now = following
    return found


@pytest.mark.parametrize(
    ('dues', 'now', 'late', 'switched'),
    [
        ([1000], 600, 0, [1000, 1100]),
        # 1160 is 10 after the end of the one before, less than a pause; 1300 is 40 after its end.
        ([1000, 1050, 1160, 1300], 0, 0, [1000, 1260, 1300, 1400]),
        ([1000], 1005, 0, [1005, 1100]),
        ([2000], 2011, 11, [2011, 2111]),  # rejected at once, and said to be late
    ],
)
def test_each_item_gets_its_pulse_and_pulses_that_nearly_touch_are_one(dues, now, late, switched):
    schedule = pulses()
    assert {schedule.add(due, None, now) for due in dues} == {late}
    assert changes(schedule, now, 5000) == switched
    assert schedule.next_change(5000) == math.inf


def test_an_item_whose_place_is_not_known_is_rejected_at_once():
    schedule = pulses()
    schedule.act(700)
    assert changes(schedule, 700, 5000) == [700, 800]


@pytest.mark.parametrize(
    ('stopped', 'acting', 'switched'), [(900, False, [5100, 5200]), (1040, True, [5000, 5060])]
)
def test_while_the_belt_stands_nothing_switches(stopped, acting, switched):
    schedule = pulses()
    schedule.add(1000, 500, now=600)
    schedule.belt.stop(stopped)
    assert schedule.next_change(stopped) == math.inf
    assert schedule.acting(stopped) == schedule.acting(5000) == acting
    run(schedule, 5000)
    assert changes(schedule, 5000, 9000) == switched


@pytest.mark.parametrize('told', [550, 1000, 1700])  # before, during and after the stop
def test_a_stop_delays_an_item_on_its_way_by_its_duration(told):
    schedule = pulses()
    actions = {600: schedule.belt.stop, 1600: lambda now: run(schedule, now)}
    actions[told] = lambda now: schedule.add(900, 500, now)
    for now in sorted(actions):
        actions[now](now)
    assert changes(schedule, 1700, 5000) == [1900, 2000]


def test_what_a_stop_delayed_is_rejected_for_longer_at_both_ends():
    before, during, after = (pulses(belt_margin=30) for _ in range(3))
    before.add(900, 500, now=550)
    for schedule in (before, during, after):
        schedule.belt.stop(600)
        if schedule is during:
            schedule.add(900, 500, now=1000)
        run(schedule, 1600)
    after.add(900, 500, now=1650)
    for schedule in (before, during, after):
        assert changes(schedule, 1650, 5000) == [1870, 2030]


def test_a_pulse_that_was_not_switched_is_counted():
    schedule = pulses()
    for due in (1000, 2000, 3000):
        schedule.add(due, None, now=0)
    assert not schedule.acting(0)
    assert schedule.acting(1050)
    assert not schedule.acting(1500)
    assert schedule.skipped == 0
    assert schedule.acting(3010)
    assert schedule.skipped == 1


def test_safe_means_that_nothing_is_to_come():
    schedule = pulses()
    schedule.add(1000, 500, now=600)
    schedule.clear()
    assert changes(schedule, 600, 5000) == []


@given(
    st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 2000)), min_size=1, max_size=20),
    st.lists(st.integers(1, 1000), max_size=6),
)
def test_every_item_finds_the_rejector_acting_for_the_whole_of_its_pulse(items, stops):
    """Against the belt walked step by step: verdicts and stops at any time, in order of time."""
    schedule = pulses(min_pause=0)
    now, running, travelled, places = 0, True, 0, []
    moments = sorted({stop * 7 for stop in stops})
    pending = sorted((came, due) for came, due in items)
    acted = set()
    for now in range(12_000):
        if moments and now == moments[0]:
            moments.pop(0)
            running = not running
            run(schedule, now) if running else schedule.belt.stop(now)
        while pending and pending[0][0] == now:
            _, ahead = pending.pop(0)
            schedule.add(now + ahead, now, now)
            places.append(travelled + ahead)
        if schedule.acting(now):
            acted.add(travelled)
        travelled += running
    if not running:
        places = [place for place in places if place + 100 < travelled]
    assert all(place + step in acted for place in places for step in range(100))


@given(st.lists(st.integers(1, 50), max_size=20), st.integers(0, 1200))
def test_the_time_of_the_belt_counts_the_steps_for_which_it_ran(lengths, asked):
    belt, now, running, ran = BeltTime(), 0, True, [0]
    for length in lengths:
        ran += [ran[-1] + running * (step + 1) for step in range(length)]
        now += length
        running = not running
        (belt.run if running else belt.stop)(now)
    ran += [ran[-1] + running * (step + 1) for step in range(1200)]
    assert belt.at(asked) == ran[asked]
    if running:
        assert belt.when(belt.at(now) + 7) == now + 7
    else:
        assert belt.when(belt.at(now) + 7) == math.inf


@pytest.mark.parametrize(('stood', 'due'), [(True, 1900), (False, 4400)])
def test_a_stop_during_the_pass_is_taken_out_of_the_speed_by_the_eyes(stood, due):
    schedule = pulses()
    if stood:
        schedule.belt.stop(300)
        run(schedule, 1300)
    # From eye to eye 200, and 500 more to the rejector; by the eyes it took 1200, which makes 3000.
    assert schedule.add(1400 + 3000, 1400, now=1450, entered=200) == 0
    assert changes(schedule, 1450, 9000) == [due, due + 100]

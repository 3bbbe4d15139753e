# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Waits that others end, in threads."""

import threading
import time

import pytest

from checkweigher_driver.stoppable_waits import StoppableWaits

LONG = 30.0  # s; a test that waits so long fails


@pytest.fixture
def waits():
    return StoppableWaits()


def _soon(action):
    """Do something while the test waits."""
    timer = threading.Timer(0.05, action)
    timer.start()
    return timer


def _stop(waits):
    with waits.change():
        waits.stopping = True


def test_a_wait_until_a_time_ends_then(waits):
    due = time.monotonic() + 0.05
    assert waits.until(due)
    assert time.monotonic() >= due


@pytest.mark.parametrize(
    'wait',
    [
        lambda waits: waits.until(time.monotonic() + LONG),
        lambda waits: waits.for_condition(lambda: False),
    ],
)
def test_every_wait_ends_when_it_is_stopped(waits, wait):
    began = time.monotonic()
    _soon(lambda: _stop(waits))
    assert not wait(waits)
    assert time.monotonic() - began < LONG
    assert not wait(waits)


def test_a_wait_ends_when_its_condition_holds_whether_or_not_that_was_told(waits):
    seen = []
    for change in (lambda: seen.append('told'), lambda: seen.append('not told')):
        count = len(seen)
        _soon(change)
        assert waits.for_condition(lambda count=count: len(seen) > count)


def test_a_wait_ends_with_its_patience(waits):
    began = time.monotonic()
    assert waits.for_condition(lambda: False, patience=0.05)
    assert 0.05 <= time.monotonic() - began < LONG


def test_meanwhile_others_may_change_what_is_waited_for(waits):
    seen = []

    def ask(waited):
        # As a publisher does in whose process the answer comes at once, from another thread.
        def answer():
            with waits.change():
                seen.append(waited)

        thread = threading.Thread(target=answer)
        thread.start()
        thread.join(timeout=LONG)
        assert not thread.is_alive()

    assert waits.for_condition(lambda: bool(seen), meanwhile=ask)
    assert seen == [pytest.approx(0.0, abs=1.0)]


def test_nothing_is_asked_where_nothing_is_waited_for(waits):
    asked = []
    assert waits.for_condition(lambda: True, meanwhile=asked.append)
    assert not asked


def test_long_waits_are_told_of(waits, monkeypatch):
    monkeypatch.setattr('checkweigher_driver.stoppable_waits._REMINDER', 0.05)
    reminders = []
    assert waits.for_condition(lambda: len(reminders) == 2, remind=lambda: reminders.append(None))

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the one-shot timer, which any thread may set."""

import threading
import time

import pytest
from running import wait_for

from checkweigher_core.ros.one_shot_timer import OneShotTimer
from checkweigher_core.ros.outputs import LOCK
from checkweigher_core.ros.port_node import PortNode

SECOND = 10**9  # ns


@pytest.fixture
def fired():
    """Return a list of the times in ns at which the timer has fired."""
    return []


@pytest.fixture
def timer(fired):
    """Yield a timer. The test fails if the callback of the timer raises an exception."""
    made = OneShotTimer(lambda: fired.append(time.monotonic_ns()), pytest.fail)
    yield made
    with LOCK:
        made.clear()


def test_it_fires_once_at_the_time_set_last(timer, fired):
    began = time.monotonic_ns()

    def set_it():
        with LOCK:
            timer.set(began + 10 * SECOND)
            timer.set(began + SECOND // 1000)
            timer.set(began + SECOND // 5)

    threading.Thread(target=set_it).start()

    wait_for(lambda: fired)
    assert began + SECOND // 5 <= fired[0] < began + 5 * SECOND
    time.sleep(0.3)
    assert len(fired) == 1


def test_one_that_was_cleared_does_not_fire(timer, fired):
    with LOCK:
        timer.set(time.monotonic_ns() + SECOND // 100)
        time.sleep(0.05)  # after this time, the thread of the timer waits for the lock
        timer.clear()
    time.sleep(0.2)
    assert fired == []


def test_the_sooner_of_two_times_counts(timer, fired):
    began = time.monotonic_ns()
    with LOCK:
        timer.set_by(began + SECOND // 10)
        timer.set_by(began + 30 * SECOND)
    wait_for(lambda: fired)
    assert fired[0] - began < 20 * SECOND


def test_it_may_be_set_again_and_again(timer, fired):
    for number in range(1, 101):
        with LOCK:
            timer.set(time.monotonic_ns() + SECOND // 1000)
        wait_for(lambda number=number: len(fired) == number)


def test_it_may_set_itself():
    times = []

    def fire():
        times.append(time.monotonic_ns())
        if len(times) < 5:
            timer.set(times[-1] + SECOND // 100)

    timer = OneShotTimer(fire, pytest.fail)
    with LOCK:
        timer.set(time.monotonic_ns())
    wait_for(lambda: len(times) == 5)
    assert times[-1] - times[0] >= 4 * SECOND // 100


def test_an_exception_of_one_is_passed_on_and_the_others_go_on(timer, fired):
    errors = []
    failing = OneShotTimer(lambda: {}['no such key'], errors.append)
    now = time.monotonic_ns()
    with LOCK:
        failing.set(now)
        timer.set(now + SECOND // 100)
    wait_for(lambda: fired)
    assert [type(error) for error in errors] == [KeyError]


def test_that_of_a_node_ends_with_the_node(process, fired):
    node = PortNode('timed')
    process.spinner.add(node)
    timer = node.create_one_shot_timer(lambda: fired.append(1))
    with LOCK:
        timer.set(time.monotonic_ns() + SECOND // 5)
    process.spinner.remove(node)
    time.sleep(0.4)
    assert fired == []

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A timer that rings once, set from any thread."""

import threading
import time

from checkweigher_core.ros.outputs import LOCK
from checkweigher_dsp.nodes.one_shot_timer import OneShotTimer

SECOND = 10**9  # ns


def test_it_rings_once_at_the_time_set_last_while_the_executor_waits(process):
    node, rung = process.node(), []
    timer = OneShotTimer(node, lambda: rung.append(time.monotonic_ns()))
    process.spinner.add(node)
    time.sleep(0.1)  # the executor waits by now
    began = time.monotonic_ns()

    def set_it():
        with LOCK:
            timer.set(began + 10 * SECOND)
            timer.set(began + SECOND // 1000)
            timer.clear()
            timer.set(began + SECOND // 5)

    threading.Thread(target=set_it).start()

    process.wait_for(lambda: rung)
    assert began + SECOND // 5 <= rung[0] < began + 5 * SECOND
    time.sleep(0.3)
    assert len(rung) == 1


def test_one_that_was_cleared_does_not_ring(process):
    node, rung = process.node(), []
    timer = OneShotTimer(node, lambda: rung.append(1))
    process.spinner.add(node)
    with LOCK:
        timer.set(time.monotonic_ns() + SECOND // 100)
        timer.clear()
    time.sleep(0.2)
    assert rung == []


def test_the_sooner_of_two_times_counts(process):
    node, rung = process.node(), []
    timer = OneShotTimer(node, lambda: rung.append(time.monotonic_ns()))
    process.spinner.add(node)
    began = time.monotonic_ns()
    with LOCK:
        timer.set_by(began + SECOND // 10)
        timer.set_by(began + 30 * SECOND)
    process.wait_for(lambda: rung)
    assert rung[0] - began < 20 * SECOND


def test_it_may_be_set_again_and_again_by_another_thread(process):
    node, rung = process.node(), []
    timer = OneShotTimer(node, lambda: rung.append(time.monotonic_ns()))
    process.spinner.add(node)
    for number in range(1, 101):
        with LOCK:
            timer.set(time.monotonic_ns() + SECOND // 1000)
        process.wait_for(lambda number=number: len(rung) == number)
    assert process.spinner.alive

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A step of the real-time clock takes the meaning from stamps for a while."""

import time

from checkweigher_driver.line_io.clock_steps import ClockStepWatch, read_clocks

S, MS = 10**9, 10**6


class Clocks:
    def __init__(self):
        self.monotonic, self.real = 5 * S, 1_700_000_000 * S

    def go(self, duration, step=0, slew=0.0):
        self.monotonic += duration
        self.real += round(duration * (1 + slew)) + step

    def __call__(self):
        return self.monotonic, self.real


def test_both_clocks_are_read_at_one_moment():
    before = time.monotonic_ns(), time.time_ns()
    monotonic, real = read_clocks()
    after = time.monotonic_ns(), time.time_ns()
    assert before[0] <= monotonic <= after[0]
    assert before[1] <= real <= after[1]


def test_a_clock_that_is_slewed_keeps_its_meaning():
    clocks = Clocks()
    watch = ClockStepWatch(5 * MS, clocks)
    for _ in range(1000):
        clocks.go(50 * MS, slew=500e-6)
        assert watch.look() == clocks.monotonic - clocks.real
    assert watch.steps == 0


def test_a_step_is_doubted_for_ten_seconds_and_then_believed():
    for step in (-S, S, 20 * MS, -20 * MS):
        clocks = Clocks()
        watch = ClockStepWatch(5 * MS, clocks)
        clocks.go(50 * MS)
        assert watch.look() is not None
        clocks.go(50 * MS, step)
        assert watch.look() is None
        clocks.go(9 * S)
        assert watch.look() is None
        clocks.go(S)
        assert watch.look() == clocks.monotonic - clocks.real
        assert watch.steps == 1

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from checkweigher_dsp.ros.access.call_limit import CallLimit


def test_a_burst_is_served_and_then_the_rate():
    limit = CallLimit(rate=10.0, burst=5)
    assert [limit.take(100.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert not limit.take(100.09)
    assert limit.take(100.11)
    assert not limit.take(100.11)


def test_no_more_than_a_burst_is_saved():
    limit = CallLimit(rate=10.0, burst=5)
    assert limit.take(0.0)
    assert [limit.take(1e6) for _ in range(6)] == [True] * 5 + [False]


def test_a_clock_that_steps_back_gives_nothing():
    limit = CallLimit(rate=10.0, burst=1)
    assert limit.take(100.0)
    assert not limit.take(0.0)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A cache that is bounded in bytes."""

import numpy as np

from checkweigher_dsp.signal.array_cache import array_cache

MEGABYTE = 2**20 // 8  # numbers


def test_a_short_array_is_made_once_and_a_long_one_each_time():
    ramp = array_cache(np.arange)

    assert ramp(MEGABYTE) is ramp(MEGABYTE)
    assert ramp(3 * MEGABYTE) is not ramp(3 * MEGABYTE)


def test_what_was_not_used_for_longest_is_forgotten():
    made = []

    @array_cache
    def ramps(size):
        made.append(size)
        return np.arange(size), np.arange(size), 'text'

    sizes = [MEGABYTE - number for number in range(5)]  # 2 MB each, for 8
    for size in (*sizes[:4], sizes[0], sizes[4], sizes[0], sizes[1]):
        ramps(size)

    assert made == [*sizes, sizes[1]]

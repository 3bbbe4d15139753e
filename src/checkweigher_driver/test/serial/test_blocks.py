# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers and limits of the values in blocks."""

import numpy as np

from checkweigher_driver.serial.blocks import BlockMaker
from checkweigher_driver.serial.decoder import Decoded
from checkweigher_driver.serial.reads import Read

S, RATE = 1_000_000_000, 100


def read(at, *counts, lost=(), overflow=()):
    """Return a read at a time in s, with values that were lost before or overflowed, by place."""
    n = range(len(counts))
    values = Decoded(
        np.array(counts, np.int32),
        np.array([place in overflow for place in n]),
        np.array([dict(lost).get(place, 0) for place in n]),
    )
    return Read(values, round(at * S), 4 * len(counts))


def settled():
    """Return the maker of a device whose clock is known: 200 samples in 2 s."""
    maker = BlockMaker(RATE, latency=0.0, limits=(-1000, 1000))
    for number in range(1, 41):
        blocks = list(maker.blocks(read(number * 0.05, *range(5))))
    assert [block.first_index for block in blocks] == [195]
    return maker


def test_a_gap_begins_a_new_block_and_an_overflow_is_at_the_limit():
    maker = settled()
    blocks = list(maker.blocks(read(2.08, 1, 2, -3, lost=[(1, 5)], overflow=[1, 2])))
    found = [(block.first_index, block.counts.tolist()) for block in blocks]
    assert found == [(200, [1]), (206, [1000, -1000])]
    assert (maker.figures()['samples'], maker.figures()['samples lost']) == (203, 5)


def test_the_index_after_a_break_is_that_of_the_time():
    maker = settled()
    first = [read(5.04, *range(4)), read(5.05, 4)]  # the first has waited in the port
    maker.resume(first)
    (block,) = maker.blocks(first[0])
    assert block.first_index == 500
    assert abs(block.stamp - 5.01 * S) < 0.01 * S

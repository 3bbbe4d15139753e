# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The buffer against a naive dictionary of index and count."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_core.records import NANOSECONDS, SampleBlock
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer

RATE = 960.0
NANOSECOND = 1  # to which stamps are rounded
START = 1_700_000_000_123_456_789


def _stamp(index, rate=RATE):
    return START + round(index * NANOSECONDS / rate)


def _block(first, counts, rate=RATE):
    return SampleBlock(_stamp(first, rate), first, np.asarray(counts, np.int32))


def _filled(*ranges, duration=1.0):
    buffer = SampleBuffer(RATE, duration)
    for begin, end in ranges:
        buffer.append(_block(begin, range(begin, end)))
    return buffer


# Where a block begins, from the next sample to come, and its length.
STEPS = st.tuples(st.sampled_from([0, 0, 0, 0, 1, 7, 40, -1, -7, -40, 90]), st.integers(0, 60))


@settings(max_examples=200)
@given(st.integers(0, 1000), st.integers(60, 90), st.lists(STEPS, max_size=30), st.data())
def test_the_buffer_agrees_with_a_dictionary(origin, capacity, steps, data):
    buffer, model, end, values = SampleBuffer(RATE, capacity / RATE), {}, origin, iter(range(10**6))
    for jump, length in steps:
        first = end + jump if model else origin
        counts = [next(values) for _ in range(length)]
        first = max(first, origin)
        buffer.append(_block(first, counts))
        for index, count in enumerate(counts, start=first):
            if index >= end:
                model[index] = count
        end = max([end, *(index + 1 for index in model)])

    assert buffer.empty == (not model)
    if not model:
        return
    assert buffer.end == end
    # The last `capacity` samples are there, unless they were lost.
    assert all(buffer.is_whole(i, i + 1) for i in range(end - capacity, end) if i in model)
    assert buffer.last_stamp == pytest.approx(_stamp(end - 1), abs=NANOSECOND)
    for _ in range(5):
        begin = data.draw(st.integers(origin - 5, end + 5))
        to = data.draw(st.integers(begin, end + 5))
        there = all(index in model for index in range(begin, to))
        if to > begin:
            assert buffer.is_whole(begin, to) == (there and begin >= buffer.start)
        if to > begin and buffer.is_whole(begin, to):
            assert buffer.read(begin, to).tolist() == [model[i] for i in range(begin, to)]


@settings(max_examples=200)
@given(st.lists(STEPS, min_size=1, max_size=12), st.data())
def test_whole_from_is_where_the_last_gap_ends(steps, data):
    buffer, there = SampleBuffer(RATE, 10.0), set()
    for jump, length in steps:
        first, end = max(buffer.end + jump, min(there, default=0)), buffer.end
        buffer.append(_block(first, [1] * length))
        there.update(range(max(first, end), first + length))
    if not there:
        return
    end = data.draw(st.integers(min(there), max(there) + 1))
    begin = data.draw(st.integers(-5, end))
    expected = next(
        (index + 1 for index in range(end - 1, begin - 1, -1) if index not in there), begin
    )

    assert buffer.whole_from(begin, end) == max(expected, min(there))


def test_time_and_index_of_a_block():
    buffer = SampleBuffer(1000.0, 1.0)
    buffer.append(SampleBlock(5_000_000, 100, np.zeros(10, np.int32)))

    # A sample each millisecond from 5 ms on.
    assert (buffer.stamp_at(100), buffer.stamp_at(107)) == (5_000_000, 12_000_000)
    indices = {3.0: 98, 4.5: 100, 5.0: 100, 5.1: 101, 6.0: 101, 25.0: 120}  # the last yet to come
    assert {ms: buffer.index_at(round(1e6 * ms)) for ms in indices} == indices


def test_each_block_ties_the_index_to_the_clock_again():
    buffer = SampleBuffer(1000.0, 1.0)
    buffer.append(SampleBlock(0, 0, np.zeros(10, np.int32)))
    # The source's crystal is slow: the second block is 0.4 ms late.
    buffer.append(SampleBlock(10_400_000, 10, np.zeros(10, np.int32)))

    assert buffer.stamp_at(9) == 9_000_000
    assert buffer.stamp_at(10) == 10_400_000
    assert buffer.stamp_at(12) == 12_400_000
    # No sample was taken between the two.
    assert [buffer.index_at(t) for t in (9_000_000, 9_500_000, 10_300_000)] == [9, 10, 10]
    assert [buffer.index_at(t) for t in (10_400_000, 10_500_000)] == [10, 11]


@given(
    st.sampled_from([960.0, 1000.0, 1200.0, 333.3, 19200.0]),
    st.sets(st.integers(1, 199)),
    st.integers(0, 199),
    st.sampled_from([-1, 0, 1]),
)
def test_an_edge_at_the_instant_of_a_sample_is_on_the_same_side_for_any_blocking(
    rate, cuts, index, rounding
):
    buffer = SampleBuffer(rate, 200 / rate)
    for begin, end in pairwise(sorted({0, 200, *cuts})):
        buffer.append(_block(begin, range(begin, end), rate))

    assert buffer.index_at(_stamp(index, rate) + rounding) == index


def test_samples_beyond_the_duration_are_forgotten():
    buffer = _filled(*((i, i + 10) for i in range(0, 10_000, 10)), duration=0.1)

    # 96 samples are kept at least, twice as many at most.
    assert 10_000 - 2 * 96 <= buffer.start <= 10_000 - 96
    assert not buffer.is_whole(buffer.start - 1, 10_000)
    assert buffer.read(9_904, 10_000).tolist() == list(range(9_904, 10_000))


@pytest.mark.parametrize('lost', [95, 96, 97, 1000, 10**12])
def test_a_gap_of_any_size_is_a_gap(lost):
    buffer = _filled((0, 50), duration=0.1)
    first = 50 + lost
    buffer.append(_block(first, range(20)))

    assert (buffer.end, buffer.is_whole(first, first + 20)) == (first + 20, True)
    assert not buffer.is_whole(first - 1, first + 1)
    assert buffer.read(first, first + 20).tolist() == list(range(20))


def test_what_is_read_does_not_change_afterwards():
    buffer = _filled((0, 50), duration=0.05)
    read = buffer.read(10, 50)
    for begin in range(50, 1000, 10):
        buffer.append(_block(begin, [-1] * 10))

    assert read.tolist() == list(range(10, 50))


def test_in_a_gap_the_index_counts_on_but_not_beyond_its_end():
    buffer = _filled((0, 10), (20, 30))

    assert [buffer.index_at(_stamp(index)) for index in (14, 20)] == [14, 20]


@pytest.mark.parametrize(
    ('end', 'first', 'late', 'restart'),
    [
        (10, 10, 0, False),  # the next block
        (10, 15, 5, False),  # a gap
        (10, 0, -10, False),  # the same again
        (10, 5, -5, False),  # an overlap
        (10, 0, 0, True),  # from 0 at the time of the next sample
        (10, 9, 100, True),
        (0, 0, 0, False),  # the first block
        # At an earlier time, from the begin on:
        (3, 0, -3, False),  # twice
        (1930, 0, -1930, False),  # 2 s late
        (1931, 0, -1931, True),
        (2890, 959, -1931, True),
        (5000, 960, -4040, False),  # not of the first second: a late one
    ],
)
def test_a_block_later_in_time_but_not_in_index_or_from_the_begin_on_is_a_restart(
    end, first, late, restart
):
    block = SampleBlock(_stamp(end + late), first, np.zeros(10, np.int32))

    assert _filled((0, end), duration=6.0).is_restart(block) == restart


def test_a_cleared_buffer_takes_any_index_and_clock():
    buffer = _filled((0, 40), (60, 80))

    buffer.clear()
    assert buffer.empty
    buffer.append(SampleBlock(5, 1000, np.arange(3, dtype=np.int32)))

    assert (buffer.start, buffer.end, buffer.origin) == (1000, 1003, 5)
    assert buffer.is_whole(1000, 1003)
    assert buffer.stamp_at(1000) == 5


@given(st.sets(st.integers(1, 499), max_size=30))
def test_the_time_of_a_sample_does_not_depend_on_how_the_blocks_were_cut(cuts):
    whole, cut = _filled((0, 500)), SampleBuffer(RATE, 1.0)
    for begin, end in pairwise([0, *sorted(cuts), 500]):
        cut.append(_block(begin, range(begin, end)))

    assert [cut.stamp_at(n) for n in range(500)] == [whole.stamp_at(n) for n in range(500)]


def test_a_clock_that_is_off_by_more_than_rounding_is_followed():
    buffer = _filled((0, 100))
    buffer.append(SampleBlock(_stamp(100) + 2, 100, np.zeros(10, np.int32)))

    assert buffer.stamp_at(99) == pytest.approx(_stamp(99), abs=NANOSECOND)
    assert buffer.stamp_at(100) == _stamp(100) + 2

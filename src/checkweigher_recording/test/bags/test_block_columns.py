"""Blocks as columns against the same blocks as objects."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.records import SampleBlock
from checkweigher_recording.bags.block_columns import BlockColumns

BLOCKS = st.lists(
    st.tuples(
        st.integers(0, 5),
        st.sampled_from([0, 1, 2, 2**64 - 1]),
        st.lists(st.integers(-(2**31), 2**31 - 1), max_size=4),
    ),
    max_size=12,
)


def _made(rows):
    return [SampleBlock(stamp, first, np.array(counts, np.int32)) for stamp, first, counts in rows]


def _shown(blocks):
    return [(block.stamp, block.first_index, block.counts.tolist()) for block in blocks]


@given(BLOCKS)
def test_a_sequence_of_the_same_blocks(rows):
    columns = BlockColumns.of(_made(rows))

    assert len(columns) == len(rows)
    assert _shown(columns) == rows
    assert _shown(columns[number] for number in range(-len(rows), len(rows))) == 2 * rows
    assert _shown(columns[1:-1]) == rows[1:-1]
    assert _shown(reversed(columns)) == rows[::-1]


@given(BLOCKS, BLOCKS)
def test_parts_follow_each_other(one, other):
    parts = [BlockColumns.of(_made(rows)) for rows in (one, other)]

    assert _shown(BlockColumns.concatenate(parts)) == one + other


@given(BLOCKS)
def test_canonical_order_is_by_stamp_and_index_and_leaves_the_rest_as_it_was(rows):
    ordered = BlockColumns.of(_made(rows)).in_canonical_order()

    assert _shown(ordered) == sorted(rows, key=lambda row: row[:2])


def test_a_block_that_is_not_there():
    with pytest.raises(IndexError):
        BlockColumns.of(_made([(0, 0, [1])]))[1]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""SQLite bags, which have no check sums: what does not fit is noticed, the rest is said."""

import sqlite3

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import read_bag


@pytest.fixture
def bag(messages, write_foreign):
    """Return an SQLite bag of the recording."""
    return write_foreign(messages, plugin=StoragePlugin.SQLITE3)


def change(bag, old, new):
    """Replace some bytes of one message, as damage does."""
    (file,) = bag.glob('*.db3')
    data = file.read_bytes()
    assert data.count(old) == 1
    assert len(old) == len(new)
    file.write_bytes(data.replace(old, new))


def test_a_whole_bag_is_read_with_a_warning(bag, recording, same):
    read = read_bag(bag)

    assert same(read, recording)
    assert 'no check sums' in read.doubt
    assert 'left out' not in read.doubt


@pytest.mark.parametrize('bit', [12, 20, 31])
def test_a_block_with_a_count_that_does_not_fit_is_left_out(bag, recording, bit):
    block = recording.blocks[40]
    counts = block.counts.copy()
    counts[3] ^= np.int64(1 << bit).astype(np.int32)
    change(bag, block.counts.tobytes(), counts.tobytes())

    read = read_bag(bag)

    assert '1 blocks' in read.doubt
    assert [each.first_index for each in read.blocks] == [
        each.first_index for each in recording.blocks if each.first_index != block.first_index
    ]


def test_a_block_with_an_index_that_does_not_fit_is_left_out(bag, recording):
    block = recording.blocks[40]
    content = len(block.counts).to_bytes(4, 'little') + block.counts.tobytes()
    old, new = (n.to_bytes(8, 'little') + content for n in (block.first_index, 2**40))
    change(bag, old, new)

    assert len(read_bag(bag).blocks) == len(recording.blocks) - 1


@pytest.mark.parametrize('later', [1 << 20, 1 << 29])
def test_an_edge_that_was_logged_at_another_time_is_refused(bag, recording, later):
    stamp = recording.edges[3].stamp
    old, new = (
        b''.join(part.to_bytes(4, 'little') for part in divmod(at, 10**9))
        for at in (stamp, stamp ^ later)
    )
    change(bag, old, new)

    with pytest.raises(BagError, match='damaged: message 4 of photo_eyes was logged at'):
        read_bag(bag)


def test_an_index_that_differs_from_its_table_is_refused(bag):
    (file,) = bag.glob('*.db3')
    with sqlite3.connect(file) as connection:
        connection.execute('PRAGMA writable_schema = ON')
        connection.execute("UPDATE sqlite_schema SET sql = 'CREATE INDEX timestamp_idx ON messages "
                           "(topic_id)' WHERE name = 'timestamp_idx'")  # fmt: skip
    connection.close()

    with pytest.raises(BagError, match='damaged: row 1 missing from index timestamp_idx'):
        read_bag(bag)


def test_a_table_that_is_a_view_is_refused(bag):
    (file,) = bag.glob('*.db3')
    with sqlite3.connect(file) as connection:
        connection.execute('ALTER TABLE messages RENAME TO others')
        connection.execute('CREATE VIEW messages AS SELECT * FROM others')
    connection.close()

    with pytest.raises(BagError, match='not a bag: it has views'):
        read_bag(bag)

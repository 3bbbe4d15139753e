# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of bags: cut or damaged anywhere, an MCAP file is refused; SQLite checks itself."""

import sqlite3

from foreign_bags import write_foreign, write_mcap
from mcap.writer import IndexType
import pytest
from rosbags.rosbag2 import StoragePlugin

from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.integrity import check_file


@pytest.fixture
def whole(bag):
    return bag / 'line_0.mcap'


NO_SUMMARY = dict.fromkeys(
    ('use_statistics', 'use_summary_offsets', 'repeat_channels', 'repeat_schemas'), False
) | {'index_types': IndexType.NONE}


def test_a_whole_file_passes(whole):
    check_file(whole)


@pytest.mark.parametrize('options', [{}, {'enable_crcs': False}, NO_SUMMARY])
def test_a_file_with_fewer_check_sums_passes(tmp_path, messages, options):
    path = tmp_path / 'line.mcap'
    write_mcap(path, [(message, message.stamp) for message in messages], **options)

    check_file(path)


def test_any_damaged_byte_is_noticed(whole):
    data = whole.read_bytes()
    tail = range(len(data) - 60, len(data))
    for position in (*range(0, len(data), max(1, len(data) // 300)), *tail):
        damaged = bytearray(data)
        damaged[position] ^= 1 << position % 8
        whole.write_bytes(damaged)
        with pytest.raises(BagError) as caught:
            check_file(whole)
        assert '\n' not in str(caught.value)
        assert str(whole) in str(caught.value)


def test_the_place_of_the_damage_is_named(whole):
    data = bytearray(whole.read_bytes())
    data[len(data) // 3] ^= 1
    whole.write_bytes(data)

    with pytest.raises(BagError, match='wrong check sum of the data, bytes'):
        check_file(whole)


def test_bytes_behind_the_end_are_noticed(whole):
    data = whole.read_bytes()
    whole.write_bytes(data + data[-100:])

    with pytest.raises(BagError, match='damaged'):
        check_file(whole)


def test_an_index_of_sqlite_that_differs_from_its_table_is_refused(tmp_path, messages):
    (file,) = write_foreign(tmp_path / 'foreign', messages, plugin=StoragePlugin.SQLITE3).glob(
        '*.db3'
    )
    check_file(file)
    with sqlite3.connect(file) as connection:
        connection.execute('PRAGMA writable_schema = ON')
        connection.execute("UPDATE sqlite_schema SET sql = 'CREATE INDEX timestamp_idx ON messages "
                           "(topic_id)' WHERE name = 'timestamp_idx'")  # fmt: skip
    connection.close()

    with pytest.raises(BagError, match='damaged: row 1 missing from index timestamp_idx'):
        check_file(file)

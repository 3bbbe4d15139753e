# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The frame of an MCAP file: cut or damaged anywhere, it is refused."""

from mcap.writer import IndexType
import pytest

from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.integrity import check_mcap
from checkweigher_recording.bags.writing import write_bag


@pytest.fixture
def whole(tmp_path, recording):
    write_bag(tmp_path / 'bag', recording.load_cell, recording)
    return tmp_path / 'bag' / 'line_0.mcap'


def test_a_whole_file_passes(whole):
    check_mcap(whole)


@pytest.mark.parametrize('options', [{}, {'enable_crcs': False}], ids=['summary', 'none'])
def test_a_file_with_fewer_check_sums_passes(tmp_path, messages, write_mcap, options):
    path = tmp_path / 'line.mcap'
    write_mcap(path, [(message, message.stamp) for message in messages], **options)

    check_mcap(path)


def test_a_file_without_a_summary_passes(tmp_path, messages, write_mcap):
    path = tmp_path / 'line.mcap'
    write_mcap(
        path,
        [(message, message.stamp) for message in messages],
        use_statistics=False,
        use_summary_offsets=False,
        repeat_channels=False,
        repeat_schemas=False,
        index_types=IndexType.NONE,
    )

    check_mcap(path)


def test_any_damaged_byte_is_noticed(whole):
    data = whole.read_bytes()
    tail = range(len(data) - 60, len(data))
    for position in (*range(0, len(data), max(1, len(data) // 300)), *tail):
        damaged = bytearray(data)
        damaged[position] ^= 1 << position % 8
        whole.write_bytes(damaged)
        with pytest.raises(BagError) as caught:
            check_mcap(whole)
        assert '\n' not in str(caught.value)
        assert str(whole) in str(caught.value)


def test_the_place_of_the_damage_is_named(whole):
    data = bytearray(whole.read_bytes())
    data[len(data) // 3] ^= 1
    whole.write_bytes(data)

    with pytest.raises(BagError, match='wrong check sum of the data before byte'):
        check_mcap(whole)


def test_bytes_behind_the_end_are_noticed(whole):
    data = whole.read_bytes()
    whole.write_bytes(data + data[-100:])

    with pytest.raises(BagError, match='damaged'):
        check_mcap(whole)


@pytest.mark.parametrize(
    ('content', 'text'),
    [(b'', 'empty'), (b'no magic bytes', 'not an MCAP file'), (b'\x89MCAP0\r\n', 'cut off')],
)
def test_a_file_of_a_few_bytes_is_refused(tmp_path, content, text):
    path = tmp_path / 'line.mcap'
    path.write_bytes(content)

    with pytest.raises(BagError, match=text):
        check_mcap(path)

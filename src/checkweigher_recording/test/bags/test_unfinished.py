# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings without an end: what is there up to the cut, and nothing where there is a hole."""

from contextlib import suppress
import shutil

from foreign_bags import refused, store_with, write_foreign
import pytest
from rosbags.rosbag2 import Reader

from checkweigher_core.ros.ports import DIAGNOSTICS, PLAYED, REFERENCE_MASS
from checkweigher_core.whole_file import OutputError
from checkweigher_recording.bags.definitions import HEADER, TIME, BagError, typestore
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.recovery import recover_bag
from checkweigher_recording.bags.writing import BagWriter

FLUSHED = 10  # messages at a time


class KilledError(Exception):
    """Ends the writing of a bag."""


@pytest.fixture
def taped(tmp_path, bag):
    """Return a function that records a line in place and breaks off after some messages."""
    with Reader(bag) as reader:
        messages = [
            (next(t for t in PLAYED if connection.topic == f'/{t.name}'), stamp, data)
            for connection, stamp, data in reader.messages()
        ]

    def tape(name='taped', begin=0, end=None, extra=(), killed=True):
        path = tmp_path / name
        with suppress(KilledError), BagWriter(path, (*PLAYED, DIAGNOSTICS), in_place=True) as bag:
            for number, message in enumerate([*extra, *messages[begin:end]], 1):
                bag.put(*message)
                if number % FLUSHED == 0:
                    bag.flush()
            if killed:
                raise KilledError
        return path

    return tape


def is_beginning(read, recording, blocks):
    """Tell whether a recording is the beginning of another, with at least so many blocks."""
    return (
        len(read.blocks) >= blocks
        and [b.counts.tolist() for b in read.blocks]
        == [b.counts.tolist() for b in recording.blocks[: len(read.blocks)]]
        and read.edges == recording.edges[: len(read.edges)]
        and read.load_cell == recording.load_cell
    )


def chunks_of(data):
    """Return where the chunks of an MCAP file begin, and the end of what is whole."""
    position, found = 8, []
    while position + 9 <= len(data):
        if data[position] == 0x06:
            found.append(position)
        position += 9 + int.from_bytes(data[position + 1 : position + 9], 'little')
    return found


def test_what_came_before_the_end_of_the_writer_is_read(taped, recording):
    path = taped(end=100)

    read = read_bag(path)

    assert sorted(file.name for file in path.iterdir()) == ['line_0.mcap']
    assert is_beginning(read, recording, 80)
    assert len(read.blocks) < len(recording.blocks)
    assert read.warning.startswith(f'{path}: the recording broke off')
    assert f'up to {(read.blocks[-1].stamp - read.blocks[0].stamp) / 1e9:.1f} s' in read.warning
    assert '(100 messages)' in read.warning


def test_a_cut_anywhere_leaves_all_whole_chunks(taped, recording):
    path = taped()
    file = path / 'line_0.mcap'
    data = file.read_bytes()
    chunks = chunks_of(data)
    assert len(chunks) > 10
    for cut in range(chunks[1], len(data), len(data) // 150):
        file.write_bytes(data[:cut])
        whole = sum(bound <= cut for bound in chunks) - 1
        read = read_bag(path)
        # A chunk has some edges or references at most beside its blocks.
        assert is_beginning(read, recording, FLUSHED * whole - 15)
    for cut in range(0, chunks[0]):
        file.write_bytes(data[:cut])
        refused(path, 'contains no readable message; the recording broke off, or has just begun')


def test_room_without_content_is_an_end_as_well(taped, recording):
    path = taped()
    file = path / 'line_0.mcap'
    data = file.read_bytes()
    cut = chunks_of(data)[5]
    for tail in (bytes(4096), data[cut : cut + 30] + bytes(4096)):
        file.write_bytes(data[:cut] + tail)
        read = read_bag(path)
        assert is_beginning(read, recording, 35)


def test_a_hole_is_refused_and_recovered_up_to_it(taped, recording, tmp_path):
    path = taped()
    file = path / 'line_0.mcap'
    data = bytearray(file.read_bytes())
    middle = chunks_of(data)[6]
    data[middle + 100] ^= 1
    file.write_bytes(data)

    refused(path, 'damaged', 'wrong check sum', 'recover')
    recover_bag(path, tmp_path / 'recovered')
    read = read_bag(tmp_path / 'recovered')
    assert is_beginning(read, recording, 45)
    assert not read.warning


def test_no_damaged_byte_gives_anything_but_a_beginning(taped, recording):
    path = taped()
    file = path / 'line_0.mcap'
    data = file.read_bytes()
    outcomes = []
    heads = [chunk + offset for chunk in chunks_of(data) for offset in range(0, 60, 7)]
    for position in (*heads, *range(0, len(data), len(data) // 200)):
        damaged = bytearray(data)
        damaged[position] ^= 1 << position % 8
        file.write_bytes(damaged)
        try:
            read = read_bag(path)
        except BagError:
            outcomes.append(0)
        else:
            # Behind a length that is wrong nothing can be found.
            assert is_beginning(read, recording, 0)
            outcomes.append(1)
    assert 0 < sum(outcomes) < len(outcomes)


def test_parts_are_read_in_order_and_none_may_be_missing(taped, recording, tmp_path):
    parts = [taped(f'part{n}', 40 * n, 40 * (n + 1), killed=n == 2) for n in range(3)]
    path = tmp_path / 'parts'
    path.mkdir()
    for number, part in zip((9, 10, 11), parts, strict=True):
        shutil.copy(part / 'line_0.mcap', path / f'line_{number}.mcap')
    assert is_beginning(read_bag(path), recording, 100)

    (path / 'line_10.mcap').rename(tmp_path / 'line_10.mcap')
    refused(path, 'there is no part 10')
    shutil.copy(parts[2] / 'line_0.mcap', path / 'line_10.mcap')
    refused(path, 'line_10.mcap: cut off')


def test_another_definition_is_refused_by_both(messages, tmp_path):
    store = store_with(REFERENCE_MASS.message_type, 'std_msgs/Header header\nfloat32 mass\n')
    reference = next(m for m in messages if m.message_type == REFERENCE_MASS.message_type)
    path = write_foreign(tmp_path / 'foreign', [reference], store=store)
    (path / 'metadata.yaml').unlink()

    refused(path, 'another definition of ' + REFERENCE_MASS.message_type)
    with pytest.raises(BagError, match='another definition of'):
        recover_bag(path, tmp_path / 'recovered')
    assert not (tmp_path / 'recovered').exists()


def test_what_all_lanes_share_is_recovered_as_well(taped, tmp_path):
    store = typestore()
    header = store.types[HEADER](store.types[TIME](1, 0), '')
    array = store.types[DIAGNOSTICS.message_type](header=header, status=[])
    data = bytes(store.serialize_cdr(array, DIAGNOSTICS.message_type))
    path = taped(end=59, extra=[(DIAGNOSTICS, 1, data)])

    assert recover_bag(path / 'line_0.mcap', tmp_path / 'recovered') == 60
    with Reader(tmp_path / 'recovered') as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts['/diagnostics'] == 1


def test_in_place_there_is_nothing_before_the_first_message(tmp_path):
    path = tmp_path / 'bag'
    with pytest.raises(KilledError), BagWriter(path, PLAYED, in_place=True):
        raise KilledError
    assert not list(tmp_path.iterdir())
    with BagWriter(path, PLAYED, in_place=True) as bag:
        bag.put(REFERENCE_MASS, 1, b'')
        assert path.exists()
        assert not (path / 'metadata.yaml').exists()
    assert sorted(file.name for file in path.iterdir()) == ['line_0.mcap', 'metadata.yaml']
    with pytest.raises(OutputError, match='exists already'):
        BagWriter(path, PLAYED, in_place=True)

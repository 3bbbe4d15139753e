# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags of any kind: the same events or one clear line."""

from dataclasses import replace
import random

from foreign_bags import refused, same, store_with, write_foreign, write_mcap, write_split
from mcap.stream_reader import zstandard  # which comes with it
from mcap.writer import CompressionType, IndexType
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore
import yaml

from checkweigher_core.records import Eye
from checkweigher_core.ros.ports import LOAD_CELL_SAMPLES as SAMPLES
from checkweigher_core.ros.ports import PLAYED
from checkweigher_recording.bags.definitions import BagError, typestore
from checkweigher_recording.bags.reading import read_bag


def _read_or_refused(path):
    """Return a recording, or None if the bag is refused with one line."""
    try:
        return read_bag(path)
    except BagError as error:
        text = str(error)
    assert '\n' not in text
    return None


# --- What is read ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('plugin', 'mode'),
    [
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
    ],
)
def test_every_kind_of_storage_is_read(tmp_path, messages, recording, plugin, mode):
    read = read_bag(write_foreign(tmp_path / 'foreign', messages, plugin=plugin, mode=mode))

    assert same(read, recording)
    assert ('no check sums' in read.warning) == (plugin is StoragePlugin.SQLITE3)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_the_order_of_the_messages_does_not_matter(tmp_path, messages, recording, seed):
    random.Random(seed).shuffle(messages)

    assert same(read_bag(write_foreign(tmp_path / 'foreign', messages)), recording)


def test_other_topics_are_left_alone(tmp_path, messages, recording):
    store = get_typestore(Stores.ROS2_JAZZY)
    for port in PLAYED:
        store.fielddefs[port.message_type] = typestore().fielddefs[port.message_type]
        store.types[port.message_type] = typestore().types[port.message_type]
    note = replace(messages[0], topic='/note', message_type='std_msgs/msg/String')
    note.content = {'data': 'shift 2'}

    assert same(
        read_bag(write_foreign(tmp_path / 'foreign', [*messages, note], store=store)), recording
    )


def test_a_lane_is_found_by_its_namespace(tmp_path, messages, recording):
    for message in messages:
        message.topic = f'/plant/lane1{message.topic}'
    path = write_foreign(tmp_path / 'foreign', messages)

    for namespace in (None, '/plant/lane1', 'plant/lane1/'):
        assert same(read_bag(path, namespace), recording)
    refused(path, 'has no lane /lane2', '/plant/lane1', namespace='lane2')


def test_of_several_lanes_one_must_be_chosen(tmp_path, messages, recording):
    other = [replace(message, topic=f'/lane2{message.topic}') for message in messages]
    path = write_foreign(tmp_path / 'foreign', [*other, *messages])

    refused(path, 'several lanes: /, /lane2')
    assert same(read_bag(path, '/'), recording)
    assert same(read_bag(path, 'lane2'), recording)


def test_a_latched_message_may_come_twice(tmp_path, messages, recording):
    again = replace(messages[0], stamp=messages[0].stamp + 10**9)

    assert same(read_bag(write_foreign(tmp_path / 'foreign', [*messages, again])), recording)


CHUNK_SIZE = 2000  # bytes, some twenty messages


@pytest.mark.parametrize(
    'options',
    [
        {'definitions': False},
        {'little_endian': False},
        {'chunk_size': CHUNK_SIZE, 'index_types': IndexType.NONE},
        *({'chunk_size': CHUNK_SIZE, 'compression': each} for each in CompressionType),
    ],
)
def test_every_kind_of_mcap_is_read(messages, recording, tmp_path, options):
    chance, latest = random.Random(1), 10**9 if 'compression' in options else 1
    late = [(message, message.stamp + chance.randrange(latest)) for message in messages]
    path = tmp_path / 'line.mcap'
    write_mcap(path, late, **options)

    assert same(read_bag(path), recording)
    assert read_bag(path).edges[0].eye is Eye.INFEED


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_different_blocks_of_one_stamp_stay_in_the_order_of_their_log_times(
    messages, tmp_path, seed
):
    chance = random.Random(seed)
    blocks = [message for message in messages if message.message_type == SAMPLES.message_type]
    timed = []
    for block in chance.choices(blocks, k=60):
        counts = block.content['counts'] + chance.randrange(5)
        again = replace(block, content=block.content | {'counts': counts})
        timed.append((again, block.stamp + chance.randrange(1, 10**9)))
    in_order = [(block, block.stamp) for block in blocks] + sorted(timed, key=lambda pair: pair[1])
    chance.shuffle(timed)
    path = tmp_path / 'line.mcap'
    write_mcap(path, [(messages[0], messages[0].stamp), *timed, *in_order[: len(blocks)]])

    read = read_bag(path).blocks

    # The sort is stable.
    expected = sorted((block for block, _ in in_order), key=lambda block: block.stamp)
    assert [block.counts.tolist() for block in read] == [
        block.content['counts'].tolist() for block in expected
    ]


def test_a_bag_of_several_files_is_read(tmp_path, messages, recording):
    folder = write_foreign(tmp_path / 'foreign', messages)
    (whole,) = folder.glob('*.mcap')
    whole.unlink()
    names = [f'part_{number}.mcap' for number in range(3)]
    for number, name in enumerate(names):
        part = messages[number::3]
        write_mcap(folder / name, [(message, message.stamp) for message in part])
    content = yaml.safe_load((folder / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information']['relative_file_paths'] = names
    (folder / 'metadata.yaml').write_text(yaml.safe_dump(content))

    assert same(read_bag(folder), recording)


@pytest.mark.parametrize(
    'mode', [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE]
)
def test_a_bag_that_rosbag2_split_and_compressed_is_read(tmp_path, messages, recording, mode):
    folder = write_split(tmp_path / 'split', messages, mode)
    ending = '.mcap.zstd' if mode is CompressionMode.FILE else '.mcap'
    assert sorted(path.name for path in folder.iterdir()) == [
        'metadata.yaml', *(f'split_{number}{ending}' for number in range(3))
    ]  # fmt: skip

    assert same(read_bag(folder), recording)


# --- What is refused ---------------------------------------------------------------------------


def test_what_is_not_a_bag(tmp_path):
    refused(tmp_path / 'none', 'there is no such file')
    (tmp_path / 'folder').mkdir()
    refused(tmp_path / 'folder', 'not a bag', 'metadata.yaml')
    (tmp_path / 'log.csv').write_text('1\n')
    refused(tmp_path / 'log.csv', 'not a bag', '.mcap')
    (tmp_path / 'text.mcap').write_text('no magic bytes in here, but long enough for a footer')
    refused(tmp_path / 'text.mcap', 'not an MCAP file')
    (tmp_path / 'empty.mcap').touch()
    refused(tmp_path / 'empty.mcap', 'empty')
    (tmp_path / 'begun.mcap').write_bytes(b'\x89MCAP0\r\n')
    refused(tmp_path / 'begun.mcap', 'cut off')
    (tmp_path / 'text.db3').write_text('no')
    refused(tmp_path / 'text.db3', 'damaged')


def test_a_folder_whose_file_is_gone(bag):
    (bag / 'line_0.mcap').unlink()
    refused(bag, 'line_0.mcap')


@pytest.mark.parametrize(
    ('topic', 'parts'),
    [
        ('/scan', ('not a recording of a checkweigher', '/scan')),
        (
            '/load_cell/samples',
            (f'holds std_msgs/msg/String, but must hold {SAMPLES.message_type}',),
        ),
    ],
)
def test_a_type_that_no_topic_of_a_checkweigher_has(tmp_path, messages, topic, parts):
    message = replace(messages[0], topic=topic, message_type='std_msgs/msg/String')
    message.content = {'data': ''}
    store = get_typestore(Stores.ROS2_JAZZY)
    refused(write_foreign(tmp_path / 'foreign', [message], store=store), topic, *parts)


def test_another_definition_of_a_known_type(tmp_path, messages):
    text = 'std_msgs/Header header\nuint64 first_index\nfloat64[] counts\n'
    store = store_with(SAMPLES.message_type, text)
    block = next(message for message in messages if message.message_type == SAMPLES.message_type)
    block.content['counts'] = np.zeros(10)
    refused(
        write_foreign(tmp_path / 'foreign', [block], store=store),
        'another definition of ' + SAMPLES.message_type,
        store.hash_rihs01(SAMPLES.message_type),
        typestore().hash_rihs01(SAMPLES.message_type),
    )


def _with_cell(messages, **content):
    return replace(messages[0], content=messages[0].content | content)


@pytest.mark.parametrize(
    ('spoil', 'text'),
    [
        (lambda all_: all_[1:], 'no load_cell/info'),
        (lambda all_: [*all_, _with_cell(all_, zero_counts=1.0)], 'load_cell/info changes'),
        (lambda all_: [_with_cell(all_, counts_per_kg=0.0)], 'counts_per_kg is 0, but must be'),
        (lambda all_: [m for m in all_ if m.message_type != SAMPLES.message_type], 'no samples'),
    ],
)
def test_a_recording_without_one_load_cell_or_samples(tmp_path, messages, spoil, text):
    refused(write_foreign(tmp_path / 'foreign', spoil(messages)), text)


@pytest.mark.parametrize(
    ('topic', 'content'),
    [
        ('/photo_eyes', {'eye': 2}),
        ('/reference_mass', {'mass': float('nan')}),
        ('/reference_mass', {'mass': 1e308}),
    ],
)
def test_a_message_that_says_nothing_sensible(tmp_path, messages, topic, content):
    message = next(message for message in messages if message.topic == topic)
    message.content |= content
    refused(write_foreign(tmp_path / 'foreign', messages), 'damaged')


# --- Damage ------------------------------------------------------------------------------------


def test_no_damaged_byte_of_the_metadata_passes_unnoticed(bag, recording):
    path = bag / 'metadata.yaml'
    whole = path.read_bytes()
    for position in range(0, len(whole), max(1, len(whole) // 150)):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << position % 8
        path.write_bytes(damaged)
        read = _read_or_refused(bag)
        assert read is None or same(read, recording)


def test_damage_within_a_file_that_is_compressed_as_a_whole(bag):
    data = bytearray((bag / 'line_0.mcap').read_bytes())
    data[len(data) // 2] ^= 1
    (bag / 'line_0.mcap').unlink()
    (bag / 'line_0.mcap.zstd').write_bytes(zstandard.compress(data))
    content = yaml.safe_load((bag / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information'] |= {
        'compression_format': 'zstd', 'compression_mode': 'FILE',
        'relative_file_paths': ['line_0.mcap.zstd'],
    }  # fmt: skip
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(content))

    refused(bag, 'line_0.mcap: damaged: wrong check sum of the data')


def test_a_message_outside_the_log_times_of_its_chunk_is_missed(tmp_path, messages):
    path = tmp_path / 'line.mcap'
    write_mcap(
        path,
        [(message, message.stamp) for message in messages],
        chunk_size=CHUNK_SIZE,
        compression=CompressionType.NONE,
        enable_crcs=False,
    )
    number = len(messages) // 3
    old, new = ((messages[number].stamp + later).to_bytes(8, 'little') for later in (0, 5 * 10**8))
    data = path.read_bytes()
    # A message has two times, of logging and of publishing.
    assert data.count(2 * old) == 1
    path.write_bytes(data.replace(2 * old, 2 * new))

    refused(path, 'messages on', 'can be read')


@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_damage_without_check_sums_ends_in_one_line_at_worst(tmp_path, messages, plugin):
    path = next(write_foreign(tmp_path / 'foreign', messages, plugin=plugin).glob('foreign.*'))
    whole = path.read_bytes()
    chance = random.Random(5)
    for _ in range(150):
        damaged = bytearray(whole)
        position = chance.randrange(len(whole))
        noise = chance.randbytes(chance.randrange(1, 40))
        damaged[position : position + len(noise)] = noise
        path.write_bytes(damaged[: len(whole)])
        _read_or_refused(path.parent)

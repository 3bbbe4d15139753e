"""A bag that is read in several processes against the same bag read in one."""

from collections import Counter
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
import os
import random

from mcap.writer import CompressionType
import pytest
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin
from ruamel.yaml import YAML

from checkweigher_driver.bag_messages import SAMPLES, BagError
from checkweigher_driver.bag_parts import read_side_by_side
from checkweigher_driver.bag_reading import read_bag
from checkweigher_dsp.side_processes import SideProcesses

CHUNK = 2000  # bytes, some twenty messages
MODULES = ('checkweigher_driver.bag_reading',)


@pytest.fixture(scope='module')
def processes():
    with SideProcesses(2, MODULES) as started:
        yield started


@pytest.fixture
def both(processes, same):
    """Return a function that reads a bag both ways, which must do the same, and in parts if so."""

    def read(path, namespace=None, *, parts=True):
        with Reader(path) as reader:
            found = read_side_by_side(path, reader, namespace, processes, lambda them, _: them)
        assert (found is not None) == parts
        plain = read_bag(path, namespace)
        assert same(read_bag(path, namespace, processes=processes), plain)
        return plain

    return read


@pytest.fixture
def write(tmp_path, write_mcap):
    """Return a function that writes messages in small chunks."""

    def written(messages, times=None, name='line.mcap', **options):
        times = [message.stamp for message in messages] if times is None else times
        path = tmp_path / name
        write_mcap(path, list(zip(messages, times, strict=True)), chunk_size=CHUNK, **options)
        return path

    return written


def test_what_was_recorded_in_order(messages, recording, write, both, same):
    path = write(messages)

    assert same(both(path), recording)


@pytest.mark.parametrize('seed', [1, 2])
def test_log_times_of_which_chunks_overlap(messages, recording, write, both, same, seed):
    chance = random.Random(seed)
    late = [message.stamp + chance.randrange(10**9) for message in messages]
    path = write(messages, late)

    assert same(both(path), recording)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_different_blocks_of_one_stamp_stay_in_the_order_of_their_log_times(
    messages, write, both, seed
):
    chance = random.Random(seed)
    blocks = [message for message in messages if message.message_type == SAMPLES.message_type]
    twice = []
    for message in chance.choices(blocks, k=60):
        content = message.content | {'counts': message.content['counts'] + chance.randrange(5)}
        twice.append(replace(message, content=content))
    chance.shuffle(all_of_them := [*messages, *twice])
    times = [message.stamp + chance.choice([0, 0, 10**7, 10**9]) for message in all_of_them]

    read = both(write(all_of_them, times))

    numbers = Counter(block.stamp for block in read.blocks)
    assert max(numbers.values()) > 1


def test_one_lane_of_two(messages, recording, write, both, same):
    other = [replace(message, topic=f'/lane2{message.topic}') for message in messages]
    shuffled = random.Random(3).sample(both_lanes := [*messages, *other], len(both_lanes))
    path = write(shuffled)

    assert same(both(path, 'lane2'), recording)


@pytest.mark.parametrize('lost', [slice(40, 44), slice(10, None, 7)], ids=['gap', 'gaps'])
def test_blocks_that_were_lost(messages, write, both, lost):
    del messages[lost]

    both(write(messages))


def test_several_files(messages, recording, write, write_foreign, both, same):
    folder = write_foreign(messages)
    (whole,) = folder.glob('*.mcap')
    whole.unlink()
    shuffled = random.Random(4).sample(messages, len(messages))
    names = [f'part_{number}.mcap' for number in range(3)]
    for number, name in enumerate(names):
        write(shuffled[number::3], name=folder / name)
    yaml = YAML(typ='safe')
    content = yaml.load((folder / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information']['relative_file_paths'] = names
    with (folder / 'metadata.yaml').open('w') as file:
        yaml.dump(content, file)

    assert same(both(folder), recording)


@pytest.mark.parametrize(
    ('plugin', 'mode'),
    [
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.NONE),  # of one chunk, as it is short
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
    ],
)
def test_what_has_no_parts_is_read_in_one(
    messages, recording, write_foreign, both, same, plugin, mode
):
    assert same(both(write_foreign(messages, plugin=plugin, mode=mode), parts=False), recording)


def test_a_damaged_chunk_is_reported_as_ever(messages, write, processes):
    path = write(messages, compression=CompressionType.NONE)
    whole = path.read_bytes()
    for number in (20, len(messages) // 2, len(messages) - 5):
        blocks = [each for each in messages[number:] if each.message_type == SAMPLES.message_type]
        damaged = bytearray(whole)
        damaged[whole.index(blocks[0].content['counts'].tobytes())] ^= 1
        path.write_bytes(damaged)
        assert _refused(path, processes) == _refused(path)


def test_a_message_that_is_not_where_its_index_says_is_missed_as_ever(messages, write, processes):
    # What its chunk says of its log times is wrong: a reader of the whole leaves it out.
    path = write(messages, compression=CompressionType.NONE, enable_crcs=False)
    number = len(messages) // 3
    old, new = ((messages[number].stamp + later).to_bytes(8, 'little') for later in (0, 5 * 10**8))
    data = path.read_bytes()
    assert data.count(2 * old) == 1
    path.write_bytes(data.replace(2 * old, 2 * new))

    assert 'messages on' in _refused(path)
    assert _refused(path, processes) == _refused(path)


def _refused(path, processes=None):
    with pytest.raises(BagError) as caught:
        read_bag(path) if processes is None else read_bag(path, processes=processes)
    return str(caught.value)


def test_what_a_process_that_dies_does_not_read_is_read_here(messages, recording, write, same):
    with SideProcesses(1) as processes:
        lost = processes.submit(os._exit, 9)
        read = read_bag(write(messages), processes=processes)

    assert isinstance(lost.exception(), BrokenProcessPool)
    assert same(read, recording)

"""A bag of which many messages are read at once against the same bag as rosbags reads it."""

from collections import Counter
from dataclasses import replace
import random

from mcap.writer import CompressionType, IndexType
import pytest
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin
from ruamel.yaml import YAML

from checkweigher_recording.bags import reading as bag_reading
from checkweigher_recording.bags.chunks import read_chunks
from checkweigher_recording.bags.lane_messages import choose_lane
from checkweigher_recording.bags.messages import SAMPLES, BagError
from checkweigher_recording.bags.reading import read_bag

CHUNK = 2000  # bytes, some twenty messages


@pytest.fixture
def read_plainly(monkeypatch):
    """Return a function that reads a bag, or says what is wrong, with rosbags alone."""

    def read(path, namespace=None):
        with monkeypatch.context() as changed:
            changed.setattr(bag_reading, 'read_chunks', lambda *_: None)
            return read_bag(path, namespace)

    return read


@pytest.fixture
def both(read_plainly, same):
    """Return a function that reads a bag both ways, which must do the same, and quickly if so."""

    def read(path, namespace=None, *, at_once=True):
        with Reader(path) as reader:
            found = read_chunks(path, reader, choose_lane(path, reader.connections, namespace))
        assert (found is not None) == at_once
        plain = read_plainly(path, namespace)
        assert same(read_bag(path, namespace), plain)
        return plain

    return read


@pytest.fixture
def refused(read_plainly):
    """Return a function that gives the complaint of a bag, which must be the same both ways."""

    def complaint(path):
        with pytest.raises(BagError) as caught:
            read_bag(path)
        with pytest.raises(BagError) as plainly:
            read_plainly(path)
        assert str(caught.value) == str(plainly.value)
        return str(caught.value)

    return complaint


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
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
    ],
)
def test_what_has_no_chunks_of_its_own_is_left_to_rosbags(
    messages, recording, write_foreign, both, same, plugin, mode
):
    assert same(both(write_foreign(messages, plugin=plugin, mode=mode), at_once=False), recording)


@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.STORAGE])
def test_what_rosbags_has_written(messages, recording, write_foreign, both, same, mode):
    assert same(both(write_foreign(messages, mode=mode)), recording)


@pytest.mark.parametrize('compression', list(CompressionType))
def test_chunks_however_they_are_packed(messages, recording, write, both, same, compression):
    assert same(both(write(messages, compression=compression)), recording)


def test_messages_of_the_other_endianness(messages, recording, write, both, same):
    assert same(both(write(messages, little_endian=False)), recording)


def test_a_file_without_indices_of_its_chunks_is_left_to_rosbags(messages, write, read_plainly):
    path = write(messages, index_types=IndexType.NONE)

    with Reader(path) as reader:
        lane = choose_lane(path, reader.connections, None)
        assert read_chunks(path, reader, lane) is None


def test_a_damaged_chunk_is_reported_as_ever(messages, write, refused):
    path = write(messages, compression=CompressionType.NONE)
    whole = path.read_bytes()
    for number in (20, len(messages) // 2, len(messages) - 5):
        blocks = [each for each in messages[number:] if each.message_type == SAMPLES.message_type]
        damaged = bytearray(whole)
        damaged[whole.index(blocks[0].content['counts'].tobytes())] ^= 1
        path.write_bytes(damaged)
        refused(path)


def test_a_message_that_is_not_where_its_index_says_is_missed_as_ever(messages, write, refused):
    # What its chunk says of its log times is wrong: a reader of the whole leaves it out.
    path = write(messages, compression=CompressionType.NONE, enable_crcs=False)
    number = len(messages) // 3
    old, new = ((messages[number].stamp + later).to_bytes(8, 'little') for later in (0, 5 * 10**8))
    data = path.read_bytes()
    assert data.count(2 * old) == 1
    path.write_bytes(data.replace(2 * old, 2 * new))

    assert 'messages on' in refused(path)


@pytest.mark.parametrize('seed', range(40))
def test_what_is_damaged_without_check_sums_is_read_or_refused_as_ever(
    messages, write, read_plainly, same, seed
):
    path = write(messages, compression=CompressionType.NONE, enable_crcs=False)
    chance, data = random.Random(seed), bytearray(path.read_bytes())
    with Reader(path) as reader:
        chunk = chance.choice(reader.storage.chunks)
    end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    for _ in range(chance.choice([1, 1, 3])):
        # Of the chunk, of its indices, or the length of a record.
        place = chance.choice([
            chance.randrange(chunk.chunk_start_offset, end),
            chance.randrange(chunk.chunk_start_offset + chunk.chunk_length, end),
            data.index(b'\x05', chance.randrange(chunk.chunk_start_offset, end)) + 1,
        ])  # fmt: skip
        data[place] = chance.randrange(256)
    path.write_bytes(data)

    found, expected = _outcome(read_bag, path), _outcome(read_plainly, path)

    assert found == expected if isinstance(expected, str) else same(found, expected)


def _outcome(read, path):
    try:
        return read(path)
    except BagError as error:
        return str(error)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Damaged bags, which are refused in one line or give the right masses."""

from collections import Counter
from collections.abc import Callable, Iterator
import os
from pathlib import Path
import random
import shutil

from lines import simulated, write_line
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.bags.definitions import BagError, typestore
from checkweigher_recording.bags.reading import read_bag
from checkweigher_validation.accuracy.results import weigh

EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
PARAMETERS = LineParameters().with_estimator('mean')
CUTS = 200
CHUNK = 4096  # bytes, so that the file has several
Damage = Callable[[bytes, random.Random], bytes]
Masses = list[tuple[object, ...]]


def as_sqlite(bag: Path, path: Path) -> Path:
    """Write the messages of a bag as an SQLite bag."""
    with (
        Reader(bag) as reader,
        BagWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as new,
    ):
        known = {
            connection.id: new.add_connection(
                connection.topic, connection.msgtype, typestore=typestore()
            )
            for connection in reader.connections
        }
        for connection, stamp, data in reader.messages():
            new.write(known[connection.id], stamp, data)
    return path


def flipped(data: bytes, chance: random.Random) -> bytes:
    """Return the data with one to three bits flipped."""
    damaged = bytearray(data)
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        damaged[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(damaged)


def _range(data: bytes, chance: random.Random) -> tuple[int, int]:
    begin = chance.randrange(len(data))
    return begin, min(len(data), begin + chance.choice([1, 8, 40, 512, 4096]))


def zeroed(data: bytes, chance: random.Random) -> bytes:
    """Return the data with zeros in a range, as a lost sector leaves them."""
    begin, end = _range(data, chance)
    return data[:begin] + bytes(end - begin) + data[end:]


def doubled(data: bytes, chance: random.Random) -> bytes:
    """Return the data with a range twice."""
    begin, end = _range(data, chance)
    return data[:end] + data[begin:]


def removed(data: bytes, chance: random.Random) -> bytes:
    """Return the data without a range."""
    begin, end = _range(data, chance)
    return data[:begin] + data[end:]


def masses_of(path: Path) -> Masses:
    """Return times, mass and reasons of each item of a bag."""
    return [
        (r.estimate.t1, r.estimate.t2, r.estimate.t3, repr(r.estimate.mass), r.estimate.reasons)
        for r in weigh(read_bag(path), PARAMETERS)
    ]


def as_ros2_records(source: Path, path: Path) -> None:
    """Copy a file as the recorder of ROS 2 writes it, with checksums of the chunks only."""
    with source.open('rb') as file, path.open('xb') as new:
        writer = Writer(new, CHUNK, CompressionType.ZSTD)
        writer.start(profile='ros2')
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small bag with reference masses."""
    line = simulated(count=3, speed=1.5, spacing=0.5, lead_in=0.6, run_out=0.3)
    return write_line(tmp_path_factory.mktemp('whole') / 'bag', line)


@pytest.fixture(scope='module')
def whole(bag: Path) -> Masses:
    """Return the masses of the bag."""
    masses = masses_of(bag)
    assert len(masses) == 3
    assert all(not reasons for *_, reasons in masses)
    return masses


@pytest.fixture(params=['folder', 'file', 'ros2'])
def copy(request: pytest.FixtureRequest, bag: Path, tmp_path: Path) -> tuple[Path, Path]:
    """Return a bag to read, and the file of the bag to damage.

    A folder with metadata.yaml, its file alone, and a file as the recorder of ROS 2 writes it.
    """
    if request.param == 'folder':
        path = shutil.copytree(bag, tmp_path / 'bag')
        return path, path / 'line_0.mcap'
    path = tmp_path / 'line.mcap'
    if request.param == 'file':
        shutil.copy(bag / 'line_0.mcap', path)
    else:
        as_ros2_records(bag / 'line_0.mcap', path)
    return path, path


def record_bounds(data: bytes) -> Iterator[int]:
    """Yield where the records of an MCAP file begin."""
    position = 8
    while position + 9 <= len(data) - 8:
        yield position
        position += 9 + int.from_bytes(data[position + 1 : position + 9], 'little')


def outcome(path: Path, whole: Masses) -> str:
    """Read a damaged bag; return 'refused' or 'right', or fail on anything else."""
    try:
        masses = masses_of(path)
    except BagError as error:
        refusal = str(error)
    else:
        assert masses == whole
        return 'right'
    assert '\n' not in refusal
    assert str(path) in refusal
    return 'refused'


def try_damages(copy: tuple[Path, Path], whole: Masses, damage: Damage, count: int) -> Counter[str]:
    """Damage a bag in `count` reproducible ways, and count the outcomes."""
    path, file = copy
    data = file.read_bytes()
    chance = random.Random(f'{damage.__name__} {file.name}')
    outcomes: Counter[str] = Counter()
    for _ in range(count):
        damaged = damage(data, chance)
        file.write_bytes(damaged)
        outcomes[outcome(path, whole) if damaged != data else 'not damaged'] += 1
    file.write_bytes(data)
    return outcomes


def test_a_cut_bag_is_refused(copy: tuple[Path, Path], whole: Masses):
    path, file = copy
    data = file.read_bytes()
    bounds = [*record_bounds(data)]
    cuts = {*bounds, *(bound + 9 for bound in bounds[:20]), *range(0, len(data), len(data) // CUTS)}
    assert len(cuts) > CUTS
    for cut in sorted(cuts):
        file.write_bytes(data[:cut])
        assert outcome(path, whole) == 'refused'


def test_a_cut_sqlite_bag_is_refused_or_gives_the_right_masses(
    bag: Path, whole: Masses, tmp_path: Path
):
    path = as_sqlite(bag, tmp_path / 'sqlite')
    assert outcome(path, whole) == 'right'
    (file,) = path.glob('*.db3')
    data = file.read_bytes()
    for cut in range(0, len(data), len(data) // 50):
        file.write_bytes(data[:cut])
        # A last page that SQLite has left empty is no loss.
        assert outcome(path, whole) in ('refused', 'right')


@pytest.mark.parametrize(
    ('damage', 'count'), [(flipped, 60), (zeroed, 20), (doubled, 20), (removed, 20)]
)
def test_no_damage_gives_other_masses(
    copy: tuple[Path, Path], whole: Masses, damage: Damage, count: int
):
    outcomes = try_damages(copy, whole, damage, EXAMPLES or count)

    assert outcomes['refused'] > outcomes['right']

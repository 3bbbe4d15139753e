# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags that no recorder writes: bombs, endless files, and damage of any kind."""

from collections.abc import Callable
import os
from pathlib import Path
import random
import shutil
import sqlite3
import struct

from mcap.stream_reader import zstandard  # which comes with it
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
import yaml

from checkweigher_recording.bags.definitions import typestore

MAGIC = b'\x89MCAP0\r\n'
MEBI = 1 << 20
# What makes a hostile bag of the folder of a good one, with a random generator; the folder is a
# copy that may be changed, and the path to read is returned.
Make = Callable[[Path, random.Random], Path]
Damage = Callable[[bytes, random.Random], bytes]
MCAP: dict[str, Make] = {}
SQLITE: dict[str, Make] = {}


def as_sqlite(bag: Path, path: Path) -> Path:
    """Write the messages of a bag as an SQLite bag."""
    with (
        Reader(bag) as reader,
        Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as new,
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


def cut(data: bytes, chance: random.Random) -> bytes:
    """Return the begin of the data."""
    return data[: chance.randrange(len(data))]


def _damages(kinds: dict[str, Make], pattern: str) -> None:
    for damage in (flipped, zeroed, doubled, removed, cut):

        def make(folder: Path, chance: random.Random, damage: Damage = damage) -> Path:
            (file,) = folder.glob(pattern)
            file.write_bytes(damage(file.read_bytes(), chance))
            return folder

        kinds[damage.__name__] = make


_damages(MCAP, '*.mcap')
_damages(SQLITE, '*.db3')


def _of_mcap(make: Make) -> Make:
    MCAP[make.__name__.strip('_')] = make
    return make


def _of_sqlite(make: Make) -> Make:
    SQLITE[make.__name__.strip('_')] = make
    return make


def _record(opcode: int, content: bytes) -> bytes:
    return bytes([opcode]) + struct.pack('<Q', len(content)) + content


def _text(content: str | bytes) -> bytes:
    data = content.encode() if isinstance(content, str) else content
    return struct.pack('<I', len(data)) + data


def _file(folder: Path, *records: bytes) -> Path:
    """Write a file of some records between a head and an end."""
    path = folder / 'made.mcap'
    head, end = _record(1, _text('ros2') + _text('x')), _record(15, bytes(4))
    path.write_bytes(MAGIC + head + b''.join(records) + end + _record(2, bytes(20)) + MAGIC)
    return path


def zeros_packed(size: int) -> bytes:
    """Return zeros in zstd."""
    packer = zstandard.ZstdCompressor().compressobj()
    return b''.join(packer.compress(bytes(MEBI)) for _ in range(size // MEBI)) + packer.flush()


def _chunk(stated: int, data: bytes, compression: str = 'zstd') -> bytes:
    content = struct.pack('<QQQI', 0, 0, stated, 0) + _text(compression)
    return _record(6, content + struct.pack('<Q', len(data)) + data)


@_of_mcap
def _chunk_that_unpacks_to_much(folder: Path, chance: random.Random) -> Path:
    size = chance.choice([65, 400, 1500]) * MEBI
    stated = chance.choice([size, 10, 40 * MEBI])
    return _file(folder, _chunk(stated, zeros_packed(size)))


@_of_mcap
def _chunk_that_states_much(folder: Path, chance: random.Random) -> Path:
    stated = 1 << chance.randrange(27, 63)
    return _file(folder, _chunk(stated, bytes(1000), chance.choice(['', 'zstd', 'lz4', 'gzip'])))


@_of_mcap
def _record_that_states_much(folder: Path, chance: random.Random) -> Path:
    length = struct.pack('<Q', 1 << chance.randrange(20, 64))
    return _file(folder, bytes([chance.randrange(16)]) + length + bytes(100))


@_of_mcap
def _empty_records(folder: Path, chance: random.Random) -> Path:
    return _file(folder, bytes(9 * chance.randrange(1, 200_000)))


@_of_mcap
def _large_definition(folder: Path, chance: random.Random) -> Path:
    text = 'int32 a\n' * (chance.choice([10_000, 2_500_000]))
    path = folder / 'made.mcap'
    with path.open('wb') as file:
        writer = McapWriter(file)
        writer.start(profile='ros2')
        name = 'checkweigher_msgs/msg/LoadCellSamples'
        schema = writer.register_schema(name, 'ros2msg', text.encode())
        channel = writer.register_channel('/load_cell/samples', 'cdr', schema)
        writer.add_message(channel, 0, b'', 0)
        writer.finish()
    return path


@_of_mcap
def _names_for_a_terminal(folder: Path, chance: random.Random) -> Path:
    names = ['/a\x1b[31mred\x07\x1b]0;title\x07', '/x' * 190_000, '/\u202efdp.exe', '/a\nb']
    path = folder / 'made.mcap'
    with path.open('wb') as file:
        writer = McapWriter(file)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel(chance.choice(names), 'cdr', schema)
        writer.add_message(channel, 0, b'', 0)
        writer.finish()
    return path


@_of_mcap
def _many_topics(folder: Path, chance: random.Random) -> Path:
    qos = 'a: &a [1]\n' if chance.random() < 0.5 else '[' * 2000
    path = folder / 'made.mcap'
    with path.open('wb') as file:
        writer = McapWriter(file)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        for number in range(chance.choice([1200, 20_000])):
            given = {'offered_qos_profiles': qos}
            writer.register_channel(f'/topic{number}', 'cdr', schema, given)
        writer.finish()
    return path


@_of_mcap
def _something_that_is_no_file(folder: Path, chance: random.Random) -> Path:
    (file,) = folder.glob('*.mcap')
    file.unlink()
    if chance.random() < 0.5:
        os.mkfifo(file)
    else:
        file.symlink_to('/dev/zero')
    return chance.choice([folder, file])


@_of_mcap
def _hole(folder: Path, chance: random.Random) -> Path:
    path = folder / 'made.mcap'
    with path.open('wb') as file:
        file.write(MAGIC)
        file.truncate(1 << chance.randrange(30, 43))
        file.seek(0, 2)
        file.write(MAGIC)
    return path


@_of_mcap
def _metadata_of_a_kind(folder: Path, chance: random.Random) -> Path:
    file = folder / 'metadata.yaml'
    text = file.read_text()
    levels = ['a0: &a0 {x: 1}']
    for level in range(1, 12):
        aliases = ', '.join(f'k{n}: *a{level - 1}' for n in range(9))
        levels.append(f'a{level}: &a{level} {{{aliases}}}')
    file.write_text(
        chance.choice([
            text + '# ' + 'x' * chance.choice([2, 40]) * MEBI,
            text + '\n'.join(levels),
            text + 'a: ' + '[' * 100_000,
            text + text,
            text.replace('line_0.mcap', '/dev/zero'),
            text.replace('line_0.mcap', '../metadata.yaml'),
            text.replace('message_count: ', 'message_count: ' + '9' * 5000),
            text.replace("compression_mode: ''", 'compression_mode: file'),
            'rosbag2_bagfile_information: &a [*a]',
        ])
    )  # fmt: skip
    return folder


def _packed(folder: Path, mode: str) -> None:
    file = folder / 'metadata.yaml'
    content = yaml.safe_load(file.read_text())
    content['rosbag2_bagfile_information'] |= {
        'compression_format': 'zstd', 'compression_mode': mode,
    }  # fmt: skip
    if mode == 'FILE':
        content['rosbag2_bagfile_information']['relative_file_paths'] = ['line_0.mcap.zstd']
    file.write_text(yaml.safe_dump(content))


@_of_mcap
def _packed_file_that_unpacks_to_much(folder: Path, chance: random.Random) -> Path:
    _packed(folder, 'FILE')
    size = chance.choice([40, 1100]) * MEBI
    (folder / 'line_0.mcap.zstd').write_bytes(zeros_packed(size))
    return folder


@_of_mcap
def _packed_messages_that_unpack_to_much(folder: Path, chance: random.Random) -> Path:
    _packed(folder, 'MESSAGE')
    (file,) = folder.glob('*.mcap')
    data = zeros_packed(chance.choice([10, 70, 1500]) * MEBI)
    with Reader(folder) as reader, (folder / 'new').open('wb') as new:
        writer = McapWriter(new)
        writer.start(profile='ros2')
        channels = {}
        for each in reader.connections:
            schema = writer.register_schema(each.msgtype, 'ros2msg', each.msgdef.data.encode())
            channels[each.id] = writer.register_channel(each.topic, 'cdr', schema)
            for _ in range(each.msgcount):
                writer.add_message(channels[each.id], 0, data, 0)
        writer.finish()
    shutil.move(folder / 'new', file)
    return folder


@_of_sqlite
def _sqlite_of_a_kind(folder: Path, chance: random.Random) -> Path:
    (file,) = folder.glob('*.db3')
    endless = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    script = chance.choice([
        'ALTER TABLE messages RENAME TO old; CREATE VIEW messages AS '
        f'{endless} SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(1000) AS data FROM n;',
        'DROP TABLE messages; CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data);',
        f'UPDATE messages SET data = zeroblob({chance.choice([100, 1 << 20, 70 << 20])}) '
        'WHERE id = 7;',
        "UPDATE messages SET data = 'text' WHERE id = 7;",
        "UPDATE messages SET timestamp = 'now' WHERE id = 7;",
        'UPDATE messages SET timestamp = -timestamp WHERE id % 3 = 0;',
        'UPDATE topics SET name = NULL;' if chance.random() < 0.5 else 'DELETE FROM topics;',
        'DELETE FROM messages WHERE id % 7 = 0;',
        'DROP INDEX timestamp_idx;',
        'CREATE TRIGGER t AFTER INSERT ON messages BEGIN SELECT 1; END;',
    ])  # fmt: skip
    connection = sqlite3.connect(file)
    try:
        connection.executescript(script)
    except sqlite3.Error:
        pass  # the table takes no such value
    finally:
        connection.close()
    return folder

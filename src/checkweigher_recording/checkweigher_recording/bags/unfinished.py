# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording without an end, because its recorder was killed: the messages that are there."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from io import BytesIO
from itertools import zip_longest
import os
from pathlib import Path
import re
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
)
from mcap.stream_reader import MAGIC_SIZE, breakup_chunk
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)

from checkweigher_core.records import NANOSECONDS
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.integrity import MAGIC

_PART_NUMBER = re.compile(r'_(\d+)$')
_HEAD_SIZE = 9  # bytes, opcode and length of a record
_PIECE = 1 << 20  # bytes
_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
# Of all records that may be among the data.
_READERS: dict[int, Callable[[ReadDataStream, int], McapRecord]] = {
    Opcode.HEADER: lambda stream, _: Header.read(stream),
    Opcode.SCHEMA: lambda stream, _: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, _: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
    Opcode.CHUNK: lambda stream, _: Chunk.read(stream),
    Opcode.MESSAGE_INDEX: lambda stream, _: MessageIndex.read(stream),
    Opcode.ATTACHMENT: lambda stream, _: Attachment.read(stream),
    Opcode.METADATA: lambda stream, _: Metadata.read(stream),
    Opcode.DATA_END: lambda stream, _: DataEnd.read(stream),
}


class UnfinishedBag:
    """The messages of the files of a recording up to where it broke off.

    `parts` are its files in the order in which they were written; of the last one the end is
    missing. `connections` are those of all parts, with the numbers of messages that are there.
    `damage` says where something is missing with more behind it, and is empty if there is no such
    place; only what is before it is there.

    Raises
    ------
    BagError
        If a file is not MCAP.
    OSError
        If a file cannot be read.
    """

    def __init__(self, parts: Sequence[Path]) -> None:
        self._parts: list[_Part] = []
        self.damage = ''
        for path, following in zip_longest(parts, parts[1:]):
            part = _Part(path)
            self._parts.append(part)
            if part.damage:
                self.damage = f'{path.name}: {part.damage}'
            elif following and not part.ended:
                self.damage = f'{path.name}: cut off, but there are parts after it'
            elif following and _number(following) > _number(path) + 1:
                self.damage = f'there is no part {_number(path) + 1}'
            if self.damage:
                break
        self.connections = [each for part in self._parts for each in part.connections()]

    @property
    def message_count(self) -> int:
        """Number of messages that are there."""
        return sum(connection.msgcount for connection in self.connections)

    @property
    def duration(self) -> float:
        """Time in s from the first message to the last one, as they were logged."""
        times = [time for part in self._parts for time in part.times]
        return (max(times) - min(times)) / NANOSECONDS

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, log time in ns and data of the messages of some connections."""
        for part in self._parts:
            wanted = {each.id: each for each in connections if each.owner is part}
            for message in part.messages():
                if message.channel_id in wanted:
                    yield wanted[message.channel_id], message.log_time, message.data


def unfinished_parts(path: Path) -> list[Path]:
    """Return the files of a folder in their order if it is a recording that was not completed.

    Such a folder has no ``metadata.yaml``: recorders write that at the end.
    """
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return []
    return sorted(path.glob('*.mcap'), key=lambda part: (_number(part), part.name))


def _number(part: Path) -> int:
    found = _PART_NUMBER.search(part.stem)
    return int(found[1]) if found else 0


class _Part:
    """An MCAP file up to where it was cut.

    `ended` is whether all its data are there, although their index may be missing. `damage` says
    where the file is not as a killed recorder or a machine without power leaves it: with a wrong
    check sum and more behind it, for instance. Messages are those before. `times` are the earliest
    and the latest log time of a message in ns, empty without any.
    """

    def __init__(self, path: Path) -> None:
        self.ended = False
        self.damage = ''
        self.times: list[int] = []
        self._path = path
        self._places: list[tuple[int, int, int]] = []  # opcode, begin and length of the contents
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        with path.open('rb') as file:
            if not MAGIC.startswith(file.read(MAGIC_SIZE)):
                raise BagError(f'{path}: not an MCAP file: its first bytes are others')
            self._scan(file)

    def connections(self) -> list[Connection]:
        """Return the channels, with the numbers of messages that are there."""
        return [self._connection(channel) for channel in self._channels.values()]

    def messages(self) -> Iterator[Message]:
        """Yield the messages."""
        with self._path.open('rb') as file:
            for opcode, begin, length in self._places:
                file.seek(begin)
                for record in _records(opcode, file.read(length)):
                    if isinstance(record, Message):
                        yield record

    def _scan(self, file: BinaryIO) -> None:
        """Read the records of the data up to the first that is not whole."""
        size, bad_chunk = os.fstat(file.fileno()).st_size, 0
        while not self.ended and len(head := file.read(_HEAD_SIZE)) == _HEAD_SIZE:
            opcode, length, begin = head[0], int.from_bytes(head[1:], 'little'), file.tell()
            if bad_chunk and opcode in (Opcode.CHUNK, Opcode.DATA_END):
                self.damage = f'wrong check sum of the chunk at byte {bad_chunk}'
                return
            if opcode not in _READERS:
                # After a loss of power, the room that the file system had reserved is still empty.
                rest = iter(lambda: file.read(_PIECE), b'')
                if any(head) or any(piece.strip(b'\0') for piece in rest):
                    self.damage = f'no record at byte {begin - _HEAD_SIZE}'
                return
            if length > size - begin:
                return
            try:
                self._add(opcode, begin, file.read(length))
            # Damaged bytes can lead decompression and parsers anywhere.
            except Exception:
                if opcode != Opcode.CHUNK:
                    self.damage = f'the record at byte {begin - _HEAD_SIZE} is not valid'
                    return
                bad_chunk = begin - _HEAD_SIZE

    def _add(self, opcode: int, begin: int, content: bytes) -> None:
        """Add the content of a record: all of it, or nothing with an exception."""
        records = _records(opcode, content)
        channels = {record.id: record for record in records if isinstance(record, Channel)}
        messages = [record for record in records if isinstance(record, Message)]
        counts = Counter(message.channel_id for message in messages)
        if not counts.keys() <= self._channels.keys() | channels.keys():
            raise ValueError('a message without its channel')
        self._schemas |= {record.id: record for record in records if isinstance(record, Schema)}
        self._channels |= channels
        self._counts += counts
        if messages:
            self._places.append((opcode, begin, len(content)))
            times = [*self.times, *(message.log_time for message in messages)]
            self.times = [min(times), max(times)]
        self.ended = opcode == Opcode.DATA_END

    def _connection(self, channel: Channel) -> Connection:
        schema = self._schemas.get(channel.schema_id, Schema(0, b'', '', ''))
        definition = MessageDefinition(MessageDefinitionFormat.NONE, '')
        if schema.encoding in _FORMATS:
            text = schema.data.decode(errors='replace')
            definition = MessageDefinition(_FORMATS[schema.encoding], text)
        digest = channel.metadata.get('topic_type_hash', '')
        extension = ConnectionExtRosbag2(channel.message_encoding, [])
        return Connection(
            channel.id, channel.topic, schema.name, definition, digest, self._counts[channel.id],
            extension, self,
        )  # fmt: skip


def _records(opcode: int, content: bytes) -> list[McapRecord]:
    """Return the records of a chunk, or the one that a record is by itself.

    A wrong check sum, or bytes that cannot be parsed, raise an exception.
    """
    record = _READERS[opcode](ReadDataStream(BytesIO(content)), len(content))
    return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of a recording without an end, because its recorder was killed."""

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
# Readers of all records of the data section.
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
    """Messages of the files of a recording up to the place where it broke off.

    `parts` are the files in the order in which they were written; the last one has no end.
    `connections` are those of all parts, with their numbers of messages. `damage` describes a place
    at which something is missing and other data follow, else it is empty. Messages after that place
    are left out.

    Raises `BagError` if a file is not MCAP, and `OSError` if a file cannot be read.
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
        """Number of messages."""
        return sum(connection.msgcount for connection in self.connections)

    @property
    def duration(self) -> float:
        """Time from the first message to the last one in s, by their log times."""
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
    """Return the files of an unfinished recording in their order, none for any other path.

    The folder of such a recording has no ``metadata.yaml``, which recorders write at the end.
    """
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return []
    return sorted(path.glob('*.mcap'), key=lambda part: (_number(part), part.name))


def _number(part: Path) -> int:
    found = _PART_NUMBER.search(part.stem)
    return int(found[1]) if found else 0


class _Part:
    """An MCAP file up to the place where it was cut.

    `ended` is whether all its data are there; its index may be missing. `damage` describes a state
    of the file that is not that of a killed recorder or a power loss, such as a wrong check sum
    with other data after it. Only messages before it are read. `times` are the earliest and the
    latest log time of a message in ns, empty without messages.
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
        """Return the channels with their numbers of messages."""
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
        """Read the records of the data up to the first incomplete one."""
        size, bad_chunk = os.fstat(file.fileno()).st_size, 0
        while not self.ended and len(head := file.read(_HEAD_SIZE)) == _HEAD_SIZE:
            opcode, length, begin = head[0], int.from_bytes(head[1:], 'little'), file.tell()
            if bad_chunk and opcode in (Opcode.CHUNK, Opcode.DATA_END):
                self.damage = f'wrong check sum of the chunk at byte {bad_chunk}'
                return
            if opcode not in _READERS:
                # After a power loss, the space that the file system had reserved may be empty.
                rest = iter(lambda: file.read(_PIECE), b'')
                if any(head) or any(piece.strip(b'\0') for piece in rest):
                    self.damage = f'no record at byte {begin - _HEAD_SIZE}'
                return
            if length > size - begin:
                return
            try:
                self._add(opcode, begin, file.read(length))
            # A parser may raise any exception for damaged bytes.
            except Exception:
                if opcode != Opcode.CHUNK:
                    self.damage = f'the record at byte {begin - _HEAD_SIZE} is not valid'
                    return
                bad_chunk = begin - _HEAD_SIZE

    def _add(self, opcode: int, begin: int, content: bytes) -> None:
        """Add the content of a record. Nothing is added if it raises an exception."""
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
        return Connection(
            id=channel.id,
            topic=channel.topic,
            msgtype=schema.name,
            msgdef=definition,
            digest=channel.metadata.get('topic_type_hash', ''),
            msgcount=self._counts[channel.id],
            ext=ConnectionExtRosbag2(channel.message_encoding, []),
            owner=self,
        )


def _records(opcode: int, content: bytes) -> list[McapRecord]:
    """Return the records of a chunk, or a single record.

    Raises an exception if a check sum is wrong or the bytes cannot be parsed.
    """
    record = _READERS[opcode](ReadDataStream(BytesIO(content)), len(content))
    return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]

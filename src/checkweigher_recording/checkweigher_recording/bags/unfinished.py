# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of a recording that has no end because its recorder was killed."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from itertools import zip_longest
import os
from pathlib import Path
import re
from typing import Any, BinaryIO

from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
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
# Kinds of records of the data section.
_RECORDS: dict[int, Any] = {
    Opcode.HEADER: mcap_records.Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
    Opcode.CHUNK: Chunk,
    Opcode.MESSAGE_INDEX: mcap_records.MessageIndex,
    Opcode.ATTACHMENT: mcap_records.Attachment,
    Opcode.METADATA: mcap_records.Metadata,
    Opcode.DATA_END: mcap_records.DataEnd,
}


class UnfinishedBag:
    """Messages of the files of a recording up to the place where it broke off.

    `parts` are the files in the order in which they were written; the last one has no end.
    `connections` are the connections of all parts, with their numbers of messages. `damage`
    describes a gap that other data follow, if any. Messages after the gap are left out.

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

    `ended` is whether the data are complete; the index may be missing. `damage` describes a fault
    that neither a killed recorder nor a power loss explains, such as a wrong check sum with other
    data after it. Only messages before it are read. `times` are the earliest and the latest log
    time of a message in ns, empty without messages.
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
            elif opcode not in _RECORDS:
                self.damage = (
                    '' if _is_empty(head, file) else f'no record at byte {begin - len(head)}'
                )
            elif length <= size - begin:
                if self._add(opcode, begin, file.read(length)):
                    continue
                if opcode == Opcode.CHUNK:
                    bad_chunk = begin - len(head)
                    continue
                self.damage = f'the record at byte {begin - len(head)} is not valid'
            return

    def _add(self, opcode: int, begin: int, content: bytes) -> bool:
        """Add the content of a record unless it is damaged; return whether it was added."""
        try:
            records = _records(opcode, content)
        except Exception:  # a parser may raise any exception for damaged bytes
            return False
        channels = {record.id: record for record in records if isinstance(record, Channel)}
        messages = [record for record in records if isinstance(record, Message)]
        counts = Counter(message.channel_id for message in messages)
        if not counts.keys() <= self._channels.keys() | channels.keys():
            return False  # a message without its channel
        self._schemas |= {record.id: record for record in records if isinstance(record, Schema)}
        self._channels |= channels
        self._counts += counts
        if messages:
            self._places.append((opcode, begin, len(content)))
            times = [*self.times, *(message.log_time for message in messages)]
            self.times = [min(times), max(times)]
        self.ended = opcode == Opcode.DATA_END
        return True

    def connections(self) -> Iterator[Connection]:
        """Yield the channels with their numbers of messages."""
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema_id, Schema(0, b'', '', ''))
            definition = MessageDefinition(MessageDefinitionFormat.NONE, '')
            if schema.encoding in _FORMATS:
                text = schema.data.decode(errors='replace')
                definition = MessageDefinition(_FORMATS[schema.encoding], text)
            yield Connection(
                id=channel.id,
                topic=channel.topic,
                msgtype=schema.name,
                msgdef=definition,
                digest=channel.metadata.get('topic_type_hash', ''),
                msgcount=self._counts[channel.id],
                ext=ConnectionExtRosbag2(channel.message_encoding, []),
                owner=self,
            )


def _is_empty(head: bytes, file: BinaryIO) -> bool:
    """Return whether only zeros follow: space that was reserved before a power loss."""
    rest = iter(lambda: file.read(_PIECE), b'')
    return not any(head) and not any(piece.strip(b'\0') for piece in rest)


def _records(opcode: int, content: bytes) -> list[McapRecord]:
    """Return the records of a chunk, or a single record.

    Raises an exception if a check sum is wrong or the bytes cannot be parsed.
    """
    kind, stream = _RECORDS[opcode], ReadDataStream(BytesIO(content))
    record = kind.read(stream, len(content)) if kind is Message else kind.read(stream)
    return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader for a recording that is incomplete because its process was killed."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from itertools import zip_longest
import os
from pathlib import Path
import re
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
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
_HEAD_SIZE = 9  # size in bytes of the head of a record, which consists of opcode and length
_PIECE = 1 << 20  # number of bytes that are read at a time
_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
# Opcodes of the records that may be in the data section of a file.
_DATA_SECTION = {
    *range(Opcode.SCHEMA, Opcode.CHUNK_INDEX),
    *(Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END),
}


class UnfinishedBag:
    """Readable messages of an incomplete recording.

    `parts` are the files in the order in which they were written. The end of the last file may be
    missing, because a killed process leaves a file that is cut off at an arbitrary byte.
    `connections` contains the connections of all files, with their message counts. If the files
    have a fault other than the missing end, `damage` describes the fault; otherwise `damage` is
    empty. Messages after a fault are ignored.

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
        """Number of readable messages."""
        return sum(connection.msgcount for connection in self.connections)

    @property
    def duration(self) -> float:
        """Difference between the earliest and the latest log time in s.

        Raises `ValueError` if there are no readable messages.
        """
        times = [time for part in self._parts for time in part.times]
        return (max(times) - min(times)) / NANOSECONDS

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, log time in ns, and data of each message of the given connections."""
        for part in self._parts:
            wanted = {each.id: each for each in connections if each.owner is part}
            for message in part.messages():
                if message.channel_id in wanted:
                    yield wanted[message.channel_id], message.log_time, message.data


def unfinished_parts(path: Path) -> list[Path]:
    """Return the MCAP files of an incomplete recording in the order in which they were written.

    The folder of an incomplete recording has no ``metadata.yaml``, because recorders write that
    file at the end. The list is empty if `path` is not the folder of an incomplete recording, or
    has no MCAP files.
    """
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return []
    return sorted(path.glob('*.mcap'), key=lambda part: (_number(part), part.name))


def _number(part: Path) -> int:
    found = _PART_NUMBER.search(part.stem)
    return int(found[1]) if found else 0


class _Part:
    """Readable part of an MCAP file that may have been cut off.

    `ended` is True if the data section is complete. `damage` describes a fault that cannot result
    from a killed process or a power loss, or is empty. For example, a wrong check sum of a chunk is
    damage if another chunk follows, because only the last chunk can be incomplete. Messages after a
    fault are ignored. `times` contains the earliest and the latest log time in ns, or is empty if
    there are no messages.
    """

    def __init__(self, path: Path) -> None:
        self.ended = False
        self.damage = ''
        self.times: list[int] = []
        self._path = path
        # Offset and size, in bytes, of each record that contains messages.
        self._places: list[tuple[int, int]] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        with path.open('rb') as file:
            if not MAGIC.startswith(file.read(MAGIC_SIZE)):
                raise BagError(f'{path}: not an MCAP file: its first bytes are wrong')
            self._scan(file)

    def messages(self) -> Iterator[Message]:
        """Yield the readable messages."""
        with self._path.open('rb') as file:
            for begin, size in self._places:
                file.seek(begin)
                for record in _records(file.read(size)):
                    if isinstance(record, Message):
                        yield record

    def _scan(self, file: BinaryIO) -> None:
        """Read the records of the data section, and set `ended` and `damage`.

        The end of the data section, the first incomplete record and the first fault end the scan.
        """
        size, bad_chunk = os.fstat(file.fileno()).st_size, 0
        while not self.ended and len(head := file.read(_HEAD_SIZE)) == _HEAD_SIZE:
            opcode, length = head[0], int.from_bytes(head[1:], 'little')
            begin = file.tell() - _HEAD_SIZE
            if bad_chunk and opcode in (Opcode.CHUNK, Opcode.DATA_END):
                self.damage = f'wrong check sum of the chunk at byte {bad_chunk}'
            elif opcode not in _DATA_SECTION:
                self.damage = '' if _is_empty(head, file) else f'no record at byte {begin}'
            elif length <= size - file.tell():
                if self._add(begin, head + file.read(length)):
                    continue
                if opcode == Opcode.CHUNK:
                    bad_chunk = begin
                    continue
                self.damage = f'the record at byte {begin} is not valid'
            return

    def _add(self, begin: int, data: bytes) -> bool:
        """Add the record at the byte `begin` unless it is damaged; return whether it was added."""
        try:
            records = _records(data)
        except Exception:  # the parsers may raise any exception for damaged bytes
            return False
        channels = {record.id: record for record in records if isinstance(record, Channel)}
        messages = [record for record in records if isinstance(record, Message)]
        counts = Counter(message.channel_id for message in messages)
        if not counts.keys() <= self._channels.keys() | channels.keys():
            return False  # the channel of a message is missing
        self._schemas |= {record.id: record for record in records if isinstance(record, Schema)}
        self._channels |= channels
        self._counts += counts
        if messages:
            self._places.append((begin, len(data)))
            times = [*self.times, *(message.log_time for message in messages)]
            self.times = [min(times), max(times)]
        self.ended = data[0] == Opcode.DATA_END
        return True

    def connections(self) -> Iterator[Connection]:
        """Yield a connection with its number of messages for each channel."""
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
    """Return whether a record head and all following bytes of the file are 0.

    Some file systems leave zero bytes after a power loss, because they reserve space in advance.
    """
    rest = iter(lambda: file.read(_PIECE), b'')
    return not any(head) and not any(piece.strip(b'\0') for piece in rest)


def _records(data: bytes) -> list[McapRecord]:
    """Return the record that consists of `data` or, if it is a chunk, the records in the chunk.

    Raises an exception if a check sum is wrong or the bytes cannot be parsed.
    """
    reader = StreamReader(BytesIO(data), skip_magic=True, emit_chunks=True, record_size_limit=None)
    record = next(reader.records)
    return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording without an end, because its recorder was killed: the messages that are there."""

from array import array
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from itertools import zip_longest
from mmap import ACCESS_READ, MADV_DONTNEED, mmap
import os
from pathlib import Path
import re

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)

from checkweigher_dsp.input_files import open_input
from checkweigher_recording.bags.bounds import (
    LARGEST_FILE,
    LARGEST_RECORD,
    MOST_DEFINITIONS,
    decompress,
)
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.integrity import MAGIC
from checkweigher_recording.bags.integrity import RECORD_HEAD as _HEAD_SIZE

_PART_NUMBER = re.compile(r'_(\d+)$')
_LONGEST = 1 << 20  # bytes of a record that is neither chunk nor index
_PAGE = 1 << 26  # bytes of a file that are in memory at a time, about
_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
_DATA_OPCODES = {
    Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK,
    Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END,
}  # fmt: skip


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


class _DamageError(Exception):
    """Bytes that no recorder leaves, however it ends."""


class _Part:
    """An MCAP file up to where it was cut.

    `ended` tells whether all its data are there, although their index may be missing. `damage` says
    where the file is not as a killed recorder or a machine without power leaves it: with a wrong
    check sum and more behind it, for instance. Messages are those before.
    """

    def __init__(self, path: Path) -> None:
        self.ended = False
        self.damage = ''
        with open_input(path, LARGEST_FILE) as file:
            # An empty file cannot be mapped.
            empty = not os.fstat(file.fileno()).st_size
            self._data = b'' if empty else mmap(file.fileno(), 0, access=ACCESS_READ)
        self._places = array('Q')  # begin and end of each record with messages
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._definitions = 0  # bytes
        if not MAGIC.startswith(self._data[: len(MAGIC)]):
            raise BagError(f'{path}: not an MCAP file: its first bytes are others')
        try:
            self._scan()
        except _DamageError as error:
            self.damage = str(error)

    def connections(self) -> list[Connection]:
        """Return the channels, with the numbers of messages that are there."""
        return [self._connection(channel) for channel in self._channels.values()]

    def messages(self) -> Iterator[Message]:
        """Yield the messages."""
        for begin, end in zip(self._places[::2], self._places[1::2], strict=True):
            for record in _records(self._record(begin, end)):
                if isinstance(record, Message):
                    yield record

    def _scan(self) -> None:
        bad_chunk = 0
        for begin, end in _places(self._data):
            is_chunk = self._data[begin] == Opcode.CHUNK
            if bad_chunk and is_chunk:
                raise _DamageError(f'wrong check sum of the chunk at byte {bad_chunk}')
            try:
                self._take(begin, end)
            # Damaged bytes can lead decompression and parsers anywhere.
            except Exception:
                if not is_chunk:
                    raise _DamageError(f'the record at byte {begin} is not valid') from None
                bad_chunk = begin
        if bad_chunk and self.ended:
            raise _DamageError(f'wrong check sum of the chunk at byte {bad_chunk}')

    def _record(self, begin: int, end: int) -> bytes:
        if end - begin > LARGEST_RECORD:
            raise _DamageError(f'a record of {end - begin} bytes at byte {begin}')
        if isinstance(self._data, mmap) and begin // _PAGE != end // _PAGE:
            self._data.madvise(MADV_DONTNEED)
        return self._data[begin:end]

    def _take(self, begin: int, end: int) -> None:
        """Take what stands in a record: all or nothing."""
        records = _records(self._record(begin, end))
        channels = {record.id: record for record in records if isinstance(record, Channel)}
        counts = Counter(record.channel_id for record in records if isinstance(record, Message))
        if not counts.keys() <= self._channels.keys() | channels.keys():
            raise _DamageError('a message without its channel')
        for record in records:
            if isinstance(record, Schema | Channel):
                self._definitions += len(str(record))
        if self._definitions > MOST_DEFINITIONS:
            raise _DamageError('too many topics')
        self._schemas |= {record.id: record for record in records if isinstance(record, Schema)}
        self._channels |= channels
        self._counts += counts
        if counts:
            self._places.extend((begin, end))
        self.ended = any(isinstance(record, DataEnd) for record in records)

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


def _places(data: bytes | mmap) -> Iterator[tuple[int, int]]:
    """Yield begin and end of each whole record of the data section."""
    position, written = MAGIC_SIZE, _written(data)
    while position + _HEAD_SIZE <= len(data):
        begin, position = position, position + _HEAD_SIZE
        length = int.from_bytes(data[begin + 1 : position], 'little')
        if not _is_record(data, begin, length, len(data)):
            # After a loss of power, the room that the file system had reserved is still empty.
            if position >= written or _is_record(data, begin, length, written):
                return
            raise _DamageError(f'no record at byte {begin}')
        position += length
        if position > len(data):
            return
        yield begin, position
        if data[begin] == Opcode.DATA_END:
            return


def _written(data: bytes | mmap) -> int:
    """Return the length of the data without the zeros at their end."""
    end = len(data)
    while end and not (last := data[max(end - _PAGE, 0) : end].rstrip(b'\0')):
        end = max(end - _PAGE, 0)
    return max(end - _PAGE, 0) + len(last) if end else 0


def _is_record(data: bytes | mmap, begin: int, length: int, size: int) -> bool:
    """Tell whether the length that a record states agrees with the lengths inside it.

    A wrong length would hide all records behind it: the file would seem to be cut there. Of `data`
    the first `size` bytes have been written, so the end of the record may be missing.
    """

    def number(offset: int, width: int) -> int:
        return int.from_bytes(data[position + offset : position + offset + width], 'little')

    opcode, position = data[begin], begin + _HEAD_SIZE
    available = size - position
    if opcode not in _DATA_OPCODES:
        return False
    if opcode == Opcode.CHUNK:
        # Two log times, size and check sum; length of the name of a compression, name; length, data
        name = number(28, 4) if available >= 32 else 0
        head = 32 + name + 8
        if available < head:
            return name <= 16 and length >= head
        return length == head + number(head - 8, 8)
    if opcode == Opcode.MESSAGE_INDEX:
        # Channel; length, entries
        return length >= 6 if available < 6 else length == 6 + number(2, 4)
    if opcode == Opcode.DATA_END:
        return length == 4
    return length <= available or available < _LONGEST


def _records(record: bytes) -> list[McapRecord]:
    """Return what a record with its head holds: the records of a chunk, or the record itself.

    A wrong check sum, or bytes that cannot be parsed, raise an exception.
    """
    if record[0] == Opcode.CHUNK:
        chunk = Chunk.read(ReadDataStream(BytesIO(record[_HEAD_SIZE:])))
        chunk.data = decompress(chunk.compression, chunk.data, chunk.uncompressed_size)
        chunk.compression = ''
        return breakup_chunk(chunk, validate_crc=True)
    # A reader wants an end.
    builder = RecordBuilder()
    Footer(0, 0, 0).write(builder)
    stream = BytesIO(record + builder.end() + MAGIC)
    *records, _ = StreamReader(stream, skip_magic=True, validate_crcs=True).records
    return records

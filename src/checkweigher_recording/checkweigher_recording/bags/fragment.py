"""What there is of an MCAP file whose recorder did not come to its end."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from io import BytesIO
from pathlib import Path
import struct

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)

from checkweigher_recording.bags.messages import BagError

Message = tuple[Connection, int, bytes]

_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')  # opcode, length of what follows
_MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
_CHUNK = struct.Struct('<QQQII')  # first and last log time, size, check sum, length of a name
_INDEX = struct.Struct('<HI')  # channel, length of what follows
_LONGEST_NAME = 16  # of a compression
_LONGEST = 1 << 20  # bytes of a record that is neither chunk nor index
_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
# What may stand before the end of the data, beside chunks, their indices and messages.
_PARSERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
    Opcode.DATA_END: DataEnd.read,
}


class _DamageError(Exception):
    """Bytes that no recorder leaves, however it ends."""


class BagFragment:
    """The messages of an MCAP file up to where it was cut.

    Parameters
    ----------
    path : Path
        File, with or without an end.

    Attributes
    ----------
    connections : list of Connection
        With the numbers of messages that are there.
    ended : bool
        Whether the data are all there, whatever is behind them.
    damage : str
        Where the file is not as a recorder leaves it that was killed, or a machine that lost its
        power: with a wrong check sum and more behind it, for instance. Messages are those before.
        Empty if there is no such place.

    Raises
    ------
    BagError
        If it is no MCAP file.
    OSError
        If it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.connections: list[Connection] = []
        self.ended = False
        self.damage = ''
        self._data = path.read_bytes()
        self._pieces: list[tuple[int, int, int]] = []  # opcode, begin, end of chunks and messages
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        if not self._data.startswith(_MAGIC[: len(self._data)]):
            raise BagError(f'{path}: not an MCAP file: its first bytes are others')
        try:
            self._scan()
        except _DamageError as error:
            self.damage = str(error)
        self.connections = [self._connection(channel) for channel in self._channels.values()]

    def messages(self, connections: Collection[Connection]) -> Iterator[Message]:
        """Yield connection, log time and data of the messages of some connections."""
        wanted = {connection.id: connection for connection in connections}
        for opcode, begin, end in self._pieces:
            for kind, record in _records_of(opcode, self._data[begin:end]):
                if kind == Opcode.MESSAGE:
                    channel, _, time, _ = _MESSAGE.unpack_from(record)
                    if channel in wanted:
                        yield wanted[channel], time, record[_MESSAGE.size :]

    def _scan(self) -> None:
        bad_chunk = 0
        for opcode, begin, end in _records(self._data):
            if opcode == Opcode.CHUNK and bad_chunk:
                raise _DamageError(f'wrong check sum of the chunk at byte {bad_chunk}')
            try:
                if end > len(self._data):
                    return
                self._take(_records_of(opcode, self._data[begin:end]))
            # Damaged bytes can lead decompression and parsers anywhere.
            except Exception:
                if opcode != Opcode.CHUNK:
                    raise _DamageError(
                        f'the record at byte {begin} says nothing sensible'
                    ) from None
                bad_chunk = begin
                continue
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
                self._pieces.append((opcode, begin, end))
            self.ended = opcode == Opcode.DATA_END
        if bad_chunk and self.ended:
            raise _DamageError(f'wrong check sum of the chunk at byte {bad_chunk}')

    def _take(self, records: Iterable[tuple[int, bytes]]) -> None:
        """Take what stands in a chunk, or a single record: all or nothing."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        counts: Counter[int] = Counter()
        for opcode, record in records:
            if opcode == Opcode.MESSAGE:
                channel, *_ = _MESSAGE.unpack_from(record)
                if channel not in self._channels and channel not in channels:
                    raise _DamageError('a message without its channel')
                counts[channel] += 1
            elif opcode in _PARSERS:
                parsed = _parsed(opcode, record)
                if isinstance(parsed, Schema):
                    schemas[parsed.id] = parsed
                elif isinstance(parsed, Channel):
                    channels[parsed.id] = parsed
        self._schemas |= schemas
        self._channels |= channels
        self._counts += counts

    def _connection(self, channel: Channel) -> Connection:
        schema = self._schemas.get(channel.schema_id)
        definition = MessageDefinition(MessageDefinitionFormat.NONE, '')
        if schema is not None and schema.encoding in _FORMATS:
            text = schema.data.decode(errors='replace')
            definition = MessageDefinition(_FORMATS[schema.encoding], text)
        return Connection(
            channel.id,
            channel.topic,
            schema.name if schema is not None else '',
            definition,
            channel.metadata.get('topic_type_hash', ''),
            self._counts[channel.id],
            ConnectionExtRosbag2(channel.message_encoding, []),
            self,
        )


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of each record up to the end of the data; the last may be cut."""
    position, written = len(_MAGIC), data.rstrip(b'\0')
    while position + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, position)
        position += _RECORD.size
        if not _is_record(opcode, data, position, length):
            # When the power goes, the room that the file system had made already is still empty.
            if position >= len(written) or _is_record(opcode, written, position, length):
                return
            raise _DamageError(f'no record at byte {position - _RECORD.size}')
        yield opcode, position, position + length
        position += length
        if opcode == Opcode.DATA_END:
            return


def _is_record(opcode: int, data: bytes, begin: int, length: int) -> bool:
    """Tell whether opcode and length of a record fit what it says of itself, as far as it goes.

    A wrong length would hide all that is behind it: the file would seem to be cut there.
    """
    head = data[begin : begin + min(length, _CHUNK.size + _LONGEST_NAME + 8)]
    if opcode == Opcode.CHUNK:
        if len(head) < _CHUNK.size:
            return length > _CHUNK.size
        name = _CHUNK.unpack_from(head)[-1]
        size = _CHUNK.size + name
        if len(head) < size + 8:
            return name <= _LONGEST_NAME and length >= size + 8
        return bool(length == size + 8 + int.from_bytes(head[size : size + 8], 'little'))
    if opcode == Opcode.MESSAGE_INDEX:
        if len(head) < _INDEX.size:
            return length >= _INDEX.size
        return bool(length == _INDEX.size + _INDEX.unpack_from(head)[1])
    if opcode != Opcode.MESSAGE and opcode not in _PARSERS:
        return False
    return begin + length <= len(data) or len(data) - begin < _LONGEST


def _records_of(opcode: int, content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of the records in a chunk, or the record itself if it is none."""
    if opcode != Opcode.CHUNK:
        yield opcode, content
        return
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    if size != chunk.uncompressed_size:
        raise _DamageError('a chunk of another size than it says')
    data = stream.read(size)
    position = 0
    while position < size:
        kind, length = _RECORD.unpack_from(data, position)
        position += _RECORD.size
        if position + length > size:
            raise _DamageError('a record without end in a chunk')
        yield kind, data[position : position + length]
        position += length


def _parsed(opcode: int, record: bytes) -> McapRecord:
    stream = ReadDataStream(BytesIO(record))
    parsed = _PARSERS[opcode](stream)
    if stream.count != len(record):
        raise _DamageError('a record that is longer than what it says')
    return parsed

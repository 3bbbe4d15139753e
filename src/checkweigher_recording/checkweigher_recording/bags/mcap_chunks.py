"""The messages in the chunks of an MCAP file, in a fraction of the time that rosbags takes."""

from collections.abc import Collection
import struct
from typing import BinaryIO

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from rosbags.rosbag2.storage_mcap import ChunkInfo, decompress

from checkweigher_recording.bags.message_decoding import StoredMessages
from checkweigher_recording.bags.messages import BagError

_CHUNK = struct.Struct('<BQQQQII')  # opcode, length, log times, size, check sum, length of a name
_RECORD = struct.Struct('<BQ')  # opcode, length of what follows
_INDEX = struct.Struct('<BQHI')  # and of an index channel, length of the entries
_ENTRY = np.dtype([('log_time', '<u8'), ('begin', '<u8')])
# What stands before a message: of packed fields, as numpy would not align them.
_HEAD = np.dtype([
    ('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'),
    ('log_time', '<u8'), ('publish_time', '<u8'),
])  # fmt: skip
_MESSAGE_OPCODE, _INDEX_OPCODE = 0x05, 0x07


def messages_of_chunk(
    file: BinaryIO, chunk: ChunkInfo, channels: Collection[int]
) -> dict[int, tuple[NDArray[np.int64], StoredMessages]]:
    """Return those messages of a chunk that rosbags has of it.

    Parameters
    ----------
    file : binary file
        That the chunk is of.
    chunk : ChunkInfo
        What the index of the file says of it.
    channels : collection of int
        Those whose messages are wanted.

    Returns
    -------
    dict of int to (ndarray, StoredMessages)
        Of each channel the log times in ns, (n,) int64, and the messages, as they follow each
        other.

    Raises
    ------
    Exception
        If the chunk is damaged, or its index says something else than the chunk.
    """
    if not any(chunk.channel_count.get(channel) for channel in channels):
        return {}
    content = _content(file, chunk)
    heads, begins, ends = _records(content, _begins(file, chunk))
    # A reader of the whole bag leaves out what is not where its index says.
    first, last = chunk.message_start_time, chunk.message_end_time
    timely = (heads['log_time'] >= first) & (heads['log_time'] <= last)
    found = {}
    for channel in channels:
        wanted = timely & (heads['channel'] == channel)
        messages = StoredMessages(content, begins[wanted], (ends - begins)[wanted])
        found[channel] = heads['log_time'][wanted].astype(np.int64), messages
    return found


def _content(file: BinaryIO, chunk: ChunkInfo) -> bytes:
    """Return what a chunk holds, unpacked; its check sum is right, if it has one."""
    file.seek(chunk.chunk_start_offset)
    head = file.read(_CHUNK.size + len(chunk.compression) + 8)
    check_sum = _CHUNK.unpack_from(head)[5]
    packed = file.read(chunk.compressed_size)
    return decompress(packed, chunk.compression, chunk.uncompressed_size, check_sum)


def _begins(file: BinaryIO, chunk: ChunkInfo) -> NDArray[np.int64]:
    """Return where the records of messages begin in a chunk, by its index."""
    begins = [np.zeros(0, np.int64)]
    for position in chunk.message_index_offsets.values():
        file.seek(position)
        opcode, _, _, length = _INDEX.unpack(file.read(_INDEX.size))
        if opcode != _INDEX_OPCODE:
            raise BagError(f'no index at byte {position}')
        begins.append(np.frombuffer(file.read(length), _ENTRY)['begin'].astype(np.int64))
    return np.sort(np.concatenate(begins))


def _records(
    content: bytes, begins: NDArray[np.int64]
) -> tuple[NDArray[np.void], NDArray[np.int64], NDArray[np.int64]]:
    """Return what stands before messages, and begin and end of each; all of the chunk is looked at.

    Raises
    ------
    BagError
        If the records do not follow each other without a gap, or there are messages beside them.
    """
    if not (len(begins) and begins[0] >= 0 and begins[-1] <= len(content) - _HEAD.itemsize):
        raise BagError('an index that points beside its chunk')
    buffer = np.frombuffer(content, np.uint8)
    heads = sliding_window_view(buffer, _HEAD.itemsize)[begins].view(_HEAD)[:, 0]
    ends = begins + _RECORD.size + np.minimum(heads['length'], len(content)).astype(np.int64)
    data = begins + _HEAD.itemsize
    if np.any((heads['opcode'] != _MESSAGE_OPCODE) | (ends < data) | (heads['log_time'] >> 63 > 0)):
        raise BagError('an index that points at what is no message')
    behind, following = np.append(0, ends), np.append(begins, len(content))
    for gap in np.flatnonzero(behind != following).tolist():
        _skip(content, int(behind[gap]), int(following[gap]))
    return heads, data, ends


def _skip(content: bytes, begin: int, end: int) -> None:
    """Look at the records between messages, which are none."""
    while begin < end:
        opcode, length = _RECORD.unpack_from(content, begin)
        if opcode == _MESSAGE_OPCODE:
            raise BagError('a message that is not in the index')
        begin += _RECORD.size + length
    if begin > end:
        raise BagError('records that overlap')

"""Own decoders of samples and edges in CDR: nearly all messages of a bag are one or the other."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
import struct
from typing import Any, overload

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from checkweigher_dsp.records import NANOSECONDS, Eye, EyeEdge, SampleBlock
from checkweigher_recording.bags.block_columns import BlockColumns

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'  # plain CDR
_HEAD = struct.Struct('<4siII')  # encapsulation; seconds, nanoseconds, length of frame_id
_TAIL = struct.Struct('<QI')  # first_index, number of counts
_FRAME = _HEAD.size  # where frame_id stands
_AT_ONCE = 4096  # messages: their bytes are kept until they are decoded


def sample_block_from(data: bytes) -> SampleBlock | None:
    """Return the block of a LoadCellSamples in little-endian CDR.

    Parameters
    ----------
    data : bytes
        The message.

    Returns
    -------
    SampleBlock or None
        None for everything that is not exactly such a message: the general decoder then says what
        it is, or what is wrong with it.
    """
    try:
        encapsulation, sec, nanosec, length = _HEAD.unpack_from(data)
        position = _tail(length)
        first_index, count = _TAIL.unpack_from(data, position)
        data[_FRAME : _FRAME - 1 + length].decode()
    except (struct.error, UnicodeDecodeError):
        return None
    begin = position + _TAIL.size
    if (
        encapsulation != _LITTLE_ENDIAN
        or not length
        or begin + 4 * count != len(data)
        or sec < 0
        or nanosec >= NANOSECONDS
    ):
        return None
    counts = np.frombuffer(data, np.dtype('<i4'), count, begin)
    return SampleBlock(sec * NANOSECONDS + nanosec, first_index, counts)


def eye_edge_from(data: bytes) -> EyeEdge | None:
    """Return the edge of a PhotoEyeEvent in little-endian CDR; None as `sample_block_from`."""
    try:
        encapsulation, sec, nanosec, length = _HEAD.unpack_from(data)
        data[_FRAME : _FRAME - 1 + length].decode()
    except (struct.error, UnicodeDecodeError):
        return None
    if (
        encapsulation != _LITTLE_ENDIAN
        or not length
        or _FRAME + length + 2 != len(data)
        or sec < 0
        or nanosec >= NANOSECONDS
        or data[-2] >= len(_EYES)
        or data[-1] > 1
    ):
        return None
    return EyeEdge(sec * NANOSECONDS + nanosec, _EYES[data[-2]], bool(data[-1]))


_EYES = (Eye.INFEED, Eye.OUTFEED)


@dataclass(frozen=True, slots=True, eq=False)
class StoredMessages(Sequence[bytes]):
    """Messages as they stand in one buffer: of many thousands each would cost more than its bytes.

    Attributes
    ----------
    content : bytes
        The buffer.
    begins, lengths : ndarray, (n,) int64
        Position and size of each message.
    """

    content: bytes
    begins: NDArray[np.int64]
    lengths: NDArray[np.int64]

    @classmethod
    def of(cls, messages: Sequence[bytes]) -> 'StoredMessages':
        """Return messages in a buffer."""
        if isinstance(messages, cls):
            return messages
        lengths = np.fromiter(map(len, messages), np.int64, len(messages))
        return cls(b''.join(messages), np.cumsum(lengths) - lengths, lengths)

    def rows(self, numbers: NDArray[np.intp], size: int) -> NDArray[np.uint8]:
        """Return the bytes of messages that are all of one size: (k, size)."""
        buffer = np.frombuffer(self.content, np.uint8)
        return sliding_window_view(buffer, size)[self.begins[numbers]]

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.begins)

    @overload
    def __getitem__(self, number: int) -> bytes: ...
    @overload
    def __getitem__(self, number: slice) -> Sequence[bytes]: ...
    def __getitem__(self, number: int | slice) -> bytes | Sequence[bytes]:
        """Return a message, or several."""
        if isinstance(number, slice):
            return StoredMessages(self.content, self.begins[number], self.lengths[number])
        begin = int(self.begins[number])
        return self.content[begin : begin + int(self.lengths[number])]

    def __iter__(self) -> Iterator[bytes]:
        """Yield the messages."""
        ends = self.begins + self.lengths
        for begin, end in zip(self.begins.tolist(), ends.tolist(), strict=True):
            yield self.content[begin:end]


class SampleDecoder:
    """Decode many messages at once; they are collected until there are enough of them.

    Parameters
    ----------
    decode : callable
        The general decoder, for what `sample_block_from` leaves to it. What it raises comes out of
        `add` or `flush`, for the first such message.
    """

    def __init__(self, decode: Callable[[bytes], SampleBlock]) -> None:
        self._decode = decode
        self._messages: list[bytes] = []
        self._parts: list[BlockColumns] = []

    def add(self, messages: Sequence[bytes]) -> None:
        """Take messages."""
        if isinstance(messages, StoredMessages):
            self.flush()
            self._take(messages)
            return
        self._messages += messages
        if len(self._messages) >= _AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Decode what has been collected."""
        messages, self._messages = self._messages, []
        if messages:
            self._take(StoredMessages.of(messages))

    def _take(self, messages: StoredMessages) -> None:
        by_length = np.argsort(messages.lengths, kind='stable')
        ends = np.flatnonzero(np.diff(messages.lengths[by_length])) + 1
        parts, order, rest = [], [], []
        for numbers in np.split(by_length, ends):
            plain, columns = _decode_equal(messages, numbers)
            parts.append(columns)
            order.append(numbers[plain])
            rest += numbers[~plain].tolist()
        rest.sort()
        blocks = [sample_block_from(messages[n]) or self._decode(messages[n]) for n in rest]
        parts.append(BlockColumns.of(blocks))
        order.append(np.asarray(rest, np.intp))
        self._parts.append(BlockColumns.concatenate(parts).taken(np.argsort(np.concatenate(order))))

    def blocks(self) -> BlockColumns:
        """Return all blocks, in the order of their messages."""
        self.flush()
        return BlockColumns.concatenate(self._parts)


def _decode_equal(
    messages: StoredMessages, numbers: NDArray[np.intp]
) -> tuple[NDArray[np.bool_], BlockColumns]:
    """Decode messages of one length as far as they are as plain as the first one.

    Parameters
    ----------
    messages : StoredMessages
        These and others.
    numbers : ndarray, (n,) int
        Which are of that length, at least one.

    Returns
    -------
    plain : ndarray, (n,) bool
        Which messages these are.
    blocks : BlockColumns
        Their blocks.
    """
    like = messages[int(numbers[0])]
    first = sample_block_from(like)
    if first is None:
        return np.zeros(len(numbers), bool), BlockColumns.of([])
    size, count = len(like), len(first.counts)
    length = _HEAD.unpack_from(like)[-1]
    rows = messages.rows(numbers, size)
    found = rows.view(_layout(size, length, count))[:, 0]
    frames = rows[:, _FRAME : _FRAME + length]
    plain: NDArray[np.bool_] = (
        (found['encapsulation'] == found['encapsulation'][0])
        & (found['sec'] >= 0)
        & (found['nanosec'] < NANOSECONDS)
        & (found['length'] == length)
        & (found['count'] == count)
        & np.all(frames == frames[0], axis=1)
    )
    found = found[plain]
    stamps = found['sec'].astype(np.int64) * NANOSECONDS + found['nanosec']
    lengths = np.full(len(found), count, np.int64)
    counts = found['counts'].astype(np.int32).reshape(-1)
    return plain, BlockColumns(stamps, found['first_index'].astype(np.uint64), lengths, counts)


@lru_cache(maxsize=256)
def _layout(size: int, length: int, count: int) -> np.dtype[Any]:
    """Return where what stands in a message of `size` bytes."""
    tail = _tail(length)
    fields: dict[str, tuple[Any, int]] = {
        'encapsulation': ('<u4', 0),
        'sec': ('<i4', 4),
        'nanosec': ('<u4', 8),
        'length': ('<u4', 12),
        'first_index': ('<u8', tail),
        'count': ('<u4', tail + 8),
        'counts': (('<i4', (count,)), tail + _TAIL.size),
    }
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({'names': list(fields), 'formats': formats, 'offsets': offsets,
                     'itemsize': size})  # fmt: skip


def _tail(length: int) -> int:
    """Return where first_index stands behind a frame_id of that length."""
    # Numbers of 8 bytes lie at multiples of 8 behind the encapsulation.
    return 4 + (12 + length + 7 & ~7)

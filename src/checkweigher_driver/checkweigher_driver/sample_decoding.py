"""Decoding of LoadCellSamples from CDR: nine in ten messages of a bag, so they have their own."""

from collections.abc import Callable, Sequence
from functools import lru_cache
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_driver.block_columns import BlockColumns
from checkweigher_dsp.records import NANOSECONDS, SampleBlock

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

    def add(self, data: bytes) -> None:
        """Take a message."""
        self._messages.append(data)
        if len(self._messages) >= _AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Decode what has been collected."""
        messages, self._messages = self._messages, []
        lengths: dict[int, list[int]] = {}
        for number, data in enumerate(messages):
            lengths.setdefault(len(data), []).append(number)
        parts, order, rest = [], [], []
        for numbers in lengths.values():
            plain, columns = _decode_equal([messages[number] for number in numbers])
            parts.append(columns)
            there = np.asarray(numbers)
            order.append(there[plain])
            rest += there[~plain].tolist()
        rest.sort()
        blocks = [sample_block_from(messages[n]) or self._decode(messages[n]) for n in rest]
        parts.append(BlockColumns.of(blocks))
        order.append(np.asarray(rest, np.intp))
        self._parts.append(BlockColumns.concatenate(parts).taken(np.argsort(np.concatenate(order))))

    def blocks(self) -> BlockColumns:
        """Return all blocks, in the order of their messages."""
        self.flush()
        return BlockColumns.concatenate(self._parts)


def _decode_equal(messages: Sequence[bytes]) -> tuple[NDArray[np.bool_], BlockColumns]:
    """Decode messages of one length as far as they are as plain as the first one.

    Returns
    -------
    plain : ndarray, (n,) bool
        Which messages these are.
    blocks : BlockColumns
        Their blocks.
    """
    first = sample_block_from(messages[0])
    if first is None:
        return np.zeros(len(messages), bool), BlockColumns.of([])
    size, count = len(messages[0]), len(first.counts)
    length = _HEAD.unpack_from(messages[0])[-1]
    data = b''.join(messages)
    found = np.frombuffer(data, _layout(size, length, count))
    frames = np.frombuffer(data, np.uint8).reshape(-1, size)[:, _FRAME : _FRAME + length]
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

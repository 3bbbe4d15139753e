# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fast decoding of many messages with samples, which are most of the messages of a bag."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import BlockColumns
from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros.ports import LOAD_CELL_SAMPLES
from checkweigher_recording.bags.definitions import deserialize, typestore

_LITTLE_ENDIAN = 0x0100  # encapsulation header of little-endian CDR, read as a little-endian number


def decode_samples(messages: Sequence[bytes]) -> BlockColumns:
    """Return the blocks of CDR messages of the type LoadCellSamples, in the same order.

    Raises the exceptions of `deserialize` if a message cannot be decoded.
    """
    sizes = np.fromiter(map(len, messages), np.int64, len(messages))
    parts: list[BlockColumns] = []
    numbers = np.zeros(0, np.int64)  # positions of the messages whose blocks are in `parts`
    for size in np.unique(sizes):
        same_size = np.flatnonzero(sizes == size)
        alike, blocks = _decode_alike([messages[number] for number in same_size])
        parts.append(blocks)
        numbers = np.append(numbers, same_size[alike])
    rest = np.setdiff1d(np.arange(len(messages)), numbers)
    others = [deserialize(LOAD_CELL_SAMPLES, messages[number]) for number in rest]
    order = np.argsort(np.append(numbers, rest))
    return BlockColumns.concatenate([*parts, BlockColumns.of(others)]).take(order)


def _decode_alike(messages: Sequence[bytes]) -> tuple[NDArray[np.bool_], BlockColumns]:
    """Decode all messages that have the layout of the first message.

    `messages` are n > 0 messages of the same size. Messages have the same layout if their
    ``frame_id`` and their number of samples are equal. Messages that are not little-endian, or
    whose stamp is not valid, are not decoded. If the first message has additional bytes, no message
    is decoded. Returns a mask of the decoded messages, (n,) bool, and their blocks.

    Raises an exception if the first message cannot be decoded.
    """
    message_type = LOAD_CELL_SAMPLES.message_type
    first: Any = typestore([LOAD_CELL_SAMPLES]).deserialize_cdr(messages[0], message_type)
    frame_size = len(first.header.frame_id.encode()) + 1
    # CDR aligns the field first_index to 8 bytes, counted from the end of the encapsulation header.
    padded_size = -(-(12 + frame_size) // 8) * 8 - 12
    layout = np.dtype(
        [
            ('encapsulation', '<u4'),
            ('sec', '<i4'),
            ('nanosec', '<u4'),
            ('frame_size', '<u4'),
            ('frame_id', 'u1', (padded_size,)),
            ('first_index', '<u8'),
            ('count', '<u4'),
            ('counts', '<i4', (len(first.counts),)),
        ]
    )
    if layout.itemsize != len(messages[0]):
        return np.zeros(len(messages), bool), BlockColumns.of([])
    rows = np.frombuffer(b''.join(messages), layout)
    alike: NDArray[np.bool_] = (
        (rows['encapsulation'] == _LITTLE_ENDIAN)
        & (rows['sec'] >= 0)
        & (rows['nanosec'] < NANOSECONDS)
        & (rows['frame_size'] == frame_size)
        & np.all(rows['frame_id'] == rows['frame_id'][0], axis=1)
        & (rows['count'] == len(first.counts))
    )
    rows = rows[alike]
    stamps = rows['sec'].astype(np.int64) * NANOSECONDS + rows['nanosec']
    lengths = np.full(len(rows), len(first.counts))
    counts = rows['counts'].astype(np.int32).reshape(-1)
    return alike, BlockColumns(stamps, rows['first_index'].astype(np.uint64), lengths, counts)

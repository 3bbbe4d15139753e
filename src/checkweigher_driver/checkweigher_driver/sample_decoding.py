"""Decoding of LoadCellSamples from CDR: nine in ten messages of a bag, so they have their own."""

import struct

import numpy as np

from checkweigher_dsp.records import NANOSECONDS, SampleBlock

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'  # plain CDR
_HEAD = struct.Struct('<4siII')  # encapsulation; seconds, nanoseconds, length of frame_id
_TAIL = struct.Struct('<QI')  # first_index, number of counts


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
        # Numbers of 8 bytes lie at multiples of 8 behind the encapsulation.
        position = 4 + (12 + length + 7 & ~7)
        first_index, count = _TAIL.unpack_from(data, position)
        data[16 : 15 + length].decode()
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

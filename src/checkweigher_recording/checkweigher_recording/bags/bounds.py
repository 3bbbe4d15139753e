# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bounds of what a bag may hold: a file of some kB can stand for gigabytes.

rosbags decompresses whatever a file holds, and parses the QoS of all its channels as YAML: both are
bounded here.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from io import BufferedReader, BytesIO
from typing import Any, BinaryIO

from mcap import stream_reader
from rosbags.rosbag2 import metadata, reader, storage_mcap, storage_sqlite3

_packages: Any = stream_reader  # has zstandard and lz4.frame

LARGEST_FILE = 64 << 30  # bytes
LARGEST_RECORD = 64 << 20  # bytes, of a chunk, compressed or not, and of a message
LARGEST_DEFINITION = 64 << 10  # bytes, of a schema, a channel or another record that describes
MOST_DEFINITIONS = 4 << 20  # bytes, of all of them
MOST_CHUNKS = 100_000
MOST_TOPICS = 1000
_LARGEST_RATIO = 1000  # of a chunk to what it is compressed to
MOST_SAMPLES = 256 << 20  # bytes, of the samples of a lane and of their blocks
MOST_EVENTS = 1_000_000  # edges and known masses of a lane


def decompress(compression: str, data: bytes, size: int) -> bytes:
    """Return the content of a chunk that states its size in bytes.

    Raises
    ------
    ValueError
        If the size is out of bounds, or is not that of the content.
    """
    most = min(LARGEST_RECORD, _LARGEST_RATIO * len(data) + LARGEST_DEFINITION)
    if size > most:
        raise ValueError(f'a chunk of {len(data)} bytes that stands for {size}; the most is {most}')
    content = data
    if compression == 'zstd':
        content = unpack_zstd(BytesIO(data)).read(size + 1)
    elif compression == 'lz4':
        content = _packages.lz4.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif compression:
        raise ValueError(f'a chunk with the unknown compression {compression!r}')
    if len(content) != size:
        raise ValueError(f'a chunk that states {size} bytes has another content')
    return content


def unpack_zstd(file: BinaryIO) -> BinaryIO:
    """Return a file with the content of zstd frames, which is unpacked as it is read."""
    unpacker = _packages.zstandard.ZstdDecompressor(max_window_size=LARGEST_RECORD)
    return BufferedReader(unpacker.stream_reader(file, read_across_frames=True))


storage_mcap.DECOMPRESSORS.update({kind: partial(decompress, kind) for kind in ('', 'lz4', 'zstd')})


@contextmanager
def qos_unread() -> Iterator[None]:
    """Have rosbags take the QoS of a channel for empty: nobody here asks for it."""
    modules: list[Any] = [metadata, reader, storage_mcap, storage_sqlite3]
    parse = metadata.parse_qos
    try:
        for module in modules:
            module.parse_qos = lambda _: []
        yield
    finally:
        for module in modules:
            module.parse_qos = parse

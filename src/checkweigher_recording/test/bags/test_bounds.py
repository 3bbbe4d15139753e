# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Chunks that unpack to gigabytes: refused before that."""

import tracemalloc

from mcap.stream_reader import lz4, zstandard
import pytest

from checkweigher_recording.bags.bounds import LARGEST_RECORD, decompress

SIZE = 100 << 20


def packed(kind: str) -> bytes:
    data = bytes(SIZE)
    return lz4.compress(data) if kind == 'lz4' else zstandard.compress(data)


@pytest.mark.parametrize('kind', ['zstd', 'lz4'])
@pytest.mark.parametrize('stated', [SIZE, 1 << 62, 1000, 0])
def test_no_more_is_unpacked_than_a_chunk_may_hold(kind, stated):
    data = packed(kind)
    tracemalloc.start()

    with pytest.raises(ValueError, match='a chunk '):
        decompress(kind, data, stated)

    assert tracemalloc.get_traced_memory()[1] < LARGEST_RECORD
    tracemalloc.stop()


@pytest.mark.parametrize('kind', ['', 'zstd', 'lz4'])
def test_a_chunk_is_unpacked(kind):
    data = bytes(range(256)) * 100
    pack = {'': bytes, 'zstd': zstandard.compress, 'lz4': lz4.compress}[kind]

    assert decompress(kind, pack(data), len(data)) == data


def test_several_frames_are_one_chunk():
    data = zstandard.compress(b'one') + zstandard.compress(b'two')

    assert decompress('zstd', data, 6) == b'onetwo'


def test_an_unknown_compression_is_refused():
    with pytest.raises(ValueError, match="unknown compression 'gzip'"):
        decompress('gzip', b'', 0)

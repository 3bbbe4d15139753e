# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether an MCAP file is whole: its magic bytes and the check sums of its data and summary."""

from io import BytesIO
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO
import zlib

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import ChunkIndex, DataEnd, Footer
from mcap.stream_reader import MAGIC_SIZE

from checkweigher_dsp.input_files import open_input
from checkweigher_recording.bags.bounds import (
    LARGEST_DEFINITION,
    LARGEST_FILE,
    LARGEST_RECORD,
    MOST_CHUNKS,
    MOST_DEFINITIONS,
)
from checkweigher_recording.bags.definitions import BagError

MAGIC = b'\x89MCAP0\r\n'
RECORD_HEAD = 9  # bytes, opcode and length of a record
_CHECK_SUM_SIZE = 4
_MOST_OPEN = 2 * LARGEST_RECORD
_LARGE = {
    Opcode.CHUNK, Opcode.MESSAGE, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.MESSAGE_INDEX,
}  # fmt: skip


def check_mcap(path: Path) -> None:
    """Check an ``.mcap`` file but for the content of its chunks, which has check sums of its own.

    Check sums are optional: one that is 0 has not been written.

    Raises
    ------
    BagError
        If the file is not MCAP, was cut, or differs from what was written.
    OSError
        If the file cannot be read.
    """
    with open_input(path, LARGEST_FILE) as file:
        size = file.seek(0, 2)
        if size == 0:
            raise BagError(f'{path}: empty; the recording has not begun')
        file.seek(0)
        if file.read(MAGIC_SIZE) != MAGIC:
            raise BagError(f'{path}: not an MCAP file: its first bytes are others')
        file.seek(max(size - MAGIC_SIZE, MAGIC_SIZE))
        if file.read() != MAGIC:
            raise BagError(
                f'{path}: cut off: the end of the file is missing; "checkweigher recover" saves '
                'what is there'
            )
        try:
            _Scan(file, size).check()
        except ValueError as error:
            raise _damaged(path, str(error)) from None
        # Damaged bytes can lead a parser anywhere, so no list of its exceptions would be complete.
        except Exception as error:
            reason = str(error) or type(error).__name__
            raise _damaged(path, f'{reason}, before byte {file.tell()}') from None


class _Scan:
    """All records of a file, one after the other; what is wrong raises a ValueError."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file = file
        self._size = size
        self._definitions = 0  # bytes
        self._chunks: list[ChunkIndex] = []

    def check(self) -> None:
        """Check sums, bounds, and the end."""
        check_sum, ended, opcode = zlib.crc32(MAGIC), False, int(Opcode.HEADER)
        self._file.seek(MAGIC_SIZE)
        while opcode != Opcode.FOOTER:
            head = self._file.read(RECORD_HEAD)
            opcode, length = head[0], int.from_bytes(head[1:], 'little')
            content = self._file.read(self._bounded(opcode, length))
            stream = ReadDataStream(BytesIO(content))
            if opcode == Opcode.DATA_END:
                ended = True
                stated = DataEnd.read(stream).data_section_crc
                if stated not in (0, check_sum):
                    before = self._file.tell()
                    raise ValueError(f'wrong check sum of the data before byte {before}')
            elif opcode == Opcode.CHUNK_INDEX:
                self._chunks.append(ChunkIndex.read(stream))
            elif opcode == Opcode.FOOTER:
                self._check_summary(Footer.read(stream))
            if not ended:
                check_sum = zlib.crc32(content, zlib.crc32(head, check_sum))
        if not ended or self._file.tell() != self._size - MAGIC_SIZE:
            raise ValueError('its data have no end')
        self._check_chunks()

    def _bounded(self, opcode: int, length: int) -> int:
        """Return the length of a record if it may be so long and is there."""
        where = f'at byte {self._file.tell() - RECORD_HEAD}'
        if opcode == 0:
            raise ValueError(f'no record {where}')
        most = LARGEST_RECORD if opcode in _LARGE else LARGEST_DEFINITION
        if opcode not in (*_LARGE, Opcode.CHUNK_INDEX):
            self._definitions += length
        if length > min(most, self._size - self._file.tell()):
            raise ValueError(f'a record of {length} bytes {where}; the most is {most}')
        if self._definitions > MOST_DEFINITIONS or len(self._chunks) > MOST_CHUNKS:
            raise ValueError(f'too many topics or chunks {where}')
        return length

    def _check_summary(self, footer: Footer) -> None:
        if not footer.summary_crc:
            return
        end = self._size - MAGIC_SIZE - _CHECK_SUM_SIZE
        begin = min(footer.summary_start or self._size - MAGIC_SIZE - FOOTER_SIZE, end)
        position = self._file.tell()
        self._file.seek(begin)
        check_sum = 0
        while (left := end - self._file.tell()) > 0:
            check_sum = zlib.crc32(self._file.read(min(left, 1 << 20)), check_sum)
        if check_sum != footer.summary_crc:
            raise ValueError(f'wrong check sum of the summary at byte {begin}')
        self._file.seek(position)

    def _check_chunks(self) -> None:
        """Check that chunks that a reader has open together fit into memory."""
        begins = [(chunk.message_start_time, chunk.uncompressed_size) for chunk in self._chunks]
        ends = [(chunk.message_end_time + 1, -chunk.uncompressed_size) for chunk in self._chunks]
        if max(accumulate(size for _, size in sorted(begins + ends)), default=0) > _MOST_OPEN:
            raise ValueError('its chunks overlap in time; sort it with "mcap sort"')


def _damaged(path: Path, what: str) -> BagError:
    return BagError(f'{path}: damaged: {what}; restore the file')

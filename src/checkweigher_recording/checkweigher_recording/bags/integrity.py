# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether an MCAP file is whole: its magic bytes and the check sums of its data and summary."""

from pathlib import Path
from typing import BinaryIO
import zlib

from mcap.reader import FOOTER_SIZE
from mcap.records import DataEnd, Footer
from mcap.stream_reader import MAGIC_SIZE, CRCValidationError, StreamReader

from checkweigher_recording.bags.definitions import BagError

MAGIC = b'\x89MCAP0\r\n'
_CHECK_SUM_SIZE = 4


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
    with path.open('rb') as file:
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
        _check_sums(path, file, size)


def _check_sums(path: Path, file: BinaryIO, size: int) -> None:
    file.seek(0)
    ended = False
    footer: Footer | None = None
    try:
        reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size)
        for record in reader.records:
            ended |= isinstance(record, DataEnd)
            if isinstance(record, Footer):
                footer = record
    except CRCValidationError:
        raise _damaged(path, f'wrong check sum of the data before byte {file.tell()}') from None
    # Damaged bytes can lead a parser anywhere, so no list of its exceptions would be complete.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise _damaged(path, f'{reason}, before byte {file.tell()}') from None
    if not ended or footer is None or file.tell() != size:
        raise _damaged(path, 'its data have no end')
    if footer.summary_crc:
        end = size - MAGIC_SIZE - _CHECK_SUM_SIZE
        begin = min(footer.summary_start or size - MAGIC_SIZE - FOOTER_SIZE, end)
        file.seek(begin)
        if zlib.crc32(file.read(end - begin)) != footer.summary_crc:
            raise _damaged(path, f'wrong check sum of the summary at byte {begin}')


def _damaged(path: Path, what: str) -> BagError:
    return BagError(f'{path}: damaged: {what}; restore the file')

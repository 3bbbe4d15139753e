# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Integrity checks of the MCAP files and SQLite files of a bag."""

from contextlib import closing
import os
from pathlib import Path
import sqlite3
import struct
from typing import BinaryIO
from urllib.parse import quote
import zlib

from mcap.opcode import Opcode
from mcap.stream_reader import MAGIC_SIZE

from checkweigher_recording.bags.definitions import BagError, bag_errors

MAGIC = b'\x89MCAP0\r\n'
# Layouts (opcode, length and content) of Data End, the last record of the data section, and of
# Footer, the last record of an MCAP file.
_DATA_END, _FOOTER = struct.Struct('<BQI'), struct.Struct('<BQQQI')
_PIECE = 1 << 20  # number of bytes that are read at a time


def check_file(path: Path, name: Path | None = None) -> None:
    """Check that a file of a bag is complete and not damaged.

    A file with the suffix ``.db3`` is checked by the integrity check of SQLite, which does not
    detect that the content of a message was changed. Any other file is checked as an MCAP file, by
    the check sums of its data section and its summary, if it contains them. The check sums of the
    chunks are not compared here, because rosbags compares them when it reads the chunks. If `path`
    is a copy, `name` is the path of the original, which is used in error messages.

    Raises `BagError` if the file cannot be read, is incomplete, or is found to be damaged.
    """
    name = name or path
    with bag_errors(name):
        if path.suffix != '.db3':
            with path.open('rb') as file:
                _check_mcap(file, name)
            return
        address = f'file:{quote(str(path.absolute()))}?mode=ro&immutable=1'
        with closing(sqlite3.connect(address, uri=True)) as connection:
            (problem,) = connection.execute('PRAGMA integrity_check(1)').fetchone()
        if problem != 'ok':
            raise BagError(f'{name}: damaged: {" ".join(problem.split())}; restore the file')


def _check_mcap(file: BinaryIO, name: Path) -> None:
    """Check the first and last bytes, the record Data End, and the check sums of an MCAP file.

    A check sum of 0 is not compared, because in MCAP it means that no check sum was computed.

    Raises `BagError` if one of the checks fails.
    """
    size = file.seek(0, os.SEEK_END)
    if size == 0:
        raise BagError(f'{name}: the file is empty; the recording has not begun')
    file.seek(0)
    if file.read(MAGIC_SIZE) != MAGIC:
        raise BagError(f'{name}: not an MCAP file: its first bytes are wrong')
    file.seek(max(size - MAGIC_SIZE, MAGIC_SIZE))
    if file.read() != MAGIC:
        raise BagError(
            f'{name}: cut off: the end of the file is missing; "checkweigher recover" saves '
            'what is there'
        )
    footer = size - MAGIC_SIZE - _FOOTER.size
    file.seek(footer)
    _, _, summary, _, summary_crc = _FOOTER.unpack(file.read(_FOOTER.size))
    summary = summary or footer
    data_end = summary - _DATA_END.size
    file.seek(data_end)
    opcode, length, data_crc = _DATA_END.unpack(file.read(_DATA_END.size))
    if (opcode, length) != (Opcode.DATA_END, 4):
        raise BagError(f'{name}: damaged: the end of its data is missing; restore the file')
    for what, begin, end, stated in (
        ('data', 0, data_end, data_crc),
        ('summary', summary, footer + _FOOTER.size - 4, summary_crc),
    ):
        if stated and stated != _check_sum(file, begin, end):
            raise BagError(
                f'{name}: damaged: wrong check sum of the {what}, bytes {begin} to {end}; restore '
                'the file'
            )


def _check_sum(file: BinaryIO, begin: int, end: int) -> int:
    check_sum = 0
    for position in range(file.seek(begin), end, _PIECE):
        check_sum = zlib.crc32(file.read(min(_PIECE, end - position)), check_sum)
    return check_sum

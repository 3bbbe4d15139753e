"""Whether an MCAP file is whole: its magic bytes, its records and the check sums around them."""

from mmap import ACCESS_READ, mmap
from pathlib import Path
import struct
import zlib

from checkweigher_recording.bags.messages import BagError

_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')  # opcode, length of what follows
_FOOTER = struct.Struct('<BQQQI')  # opcode, length, summary start, offset start, check sum
_CHECK_SUM = struct.Struct('<I')
_FOOTER_OPCODE, _DATA_END_OPCODE = 0x02, 0x0F


def check_mcap(path: Path) -> None:
    """Check the frame of an MCAP file; readers check the chunks within.

    The check sums are optional: one that is 0 has not been written.

    Parameters
    ----------
    path : Path
        An ``.mcap`` file.

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
        with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
            if data[: len(_MAGIC)] != _MAGIC:
                raise BagError(f'{path}: not an MCAP file: its first bytes are others')
            footer = size - len(_MAGIC) - _FOOTER.size
            if footer < len(_MAGIC) or data[size - len(_MAGIC) :] != _MAGIC:
                raise BagError(
                    f'{path}: cut off: the end of the file is missing; "checkweigher recover" '
                    'saves what is there'
                )
            _check_summary(path, data, footer)
            _check_data(path, data, footer)


def _check_summary(path: Path, data: mmap, footer: int) -> None:
    opcode, length, begin, _, stated = _FOOTER.unpack_from(data, footer)
    if opcode != _FOOTER_OPCODE or length != _FOOTER.size - _RECORD.size:
        raise BagError(f'{path}: damaged: no footer at byte {footer}; restore the file')
    if not stated:
        return
    begin = begin or footer
    end = footer + _FOOTER.size - _CHECK_SUM.size
    if begin > footer or _check_sum(data, begin, end) != stated:
        raise BagError(
            f'{path}: damaged: wrong check sum of the summary at byte {begin}; restore the file'
        )


def _check_data(path: Path, data: mmap, footer: int) -> None:
    position = len(_MAGIC)
    while position < footer:
        opcode, length = _RECORD.unpack_from(data, position)
        following = position + _RECORD.size + length
        if following > footer:
            break
        if opcode == _DATA_END_OPCODE:
            (stated,) = _CHECK_SUM.unpack_from(data, position + _RECORD.size)
            if stated and _check_sum(data, 0, position) != stated:
                raise BagError(
                    f'{path}: damaged: wrong check sum of the data before byte {position}; '
                    'restore the file'
                )
            return
        position = following
    raise BagError(f'{path}: damaged: the record at byte {position} has no end; restore the file')


def _check_sum(data: mmap, begin: int, end: int) -> int:
    with memoryview(data) as view, view[begin:end] as part:
        return zlib.crc32(part)

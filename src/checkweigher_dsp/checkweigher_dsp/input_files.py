# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that somebody else wrote, read within bounds: regular ones of a bounded size."""

import errno
import os
from pathlib import Path
import stat
from typing import BinaryIO

_LARGEST_TEXT = 1 << 20  # bytes


def open_input(path: Path, largest: int) -> BinaryIO:
    """Open a regular file of at most `largest` bytes, or a link to one.

    A pipe or a device may have no end, and to open one may hang.

    Raises
    ------
    OSError
        If it cannot be opened, is something else, or is larger.
    """
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        status = os.fstat(number)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, 'not a regular file; copy it into one', str(path))
        if status.st_size > largest:
            raise _too_large(path, largest)
    except BaseException:
        os.close(number)
        raise
    return open(number, 'rb')


def read_input(path: Path, largest: int = _LARGEST_TEXT) -> bytes:
    """Return the content of a file; OSError as of `open_input`."""
    with open_input(path, largest) as file:
        data = file.read(largest + 1)  # some files of the kernel state no size
    if len(data) > largest:
        raise _too_large(path, largest)
    return data


def _too_large(path: Path, largest: int) -> OSError:
    size = f'{largest >> 20} MiB' if largest >= 1 << 20 else f'{largest} bytes'
    return OSError(errno.EFBIG, f'larger than {size}; make it smaller', str(path))

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that appear under their name whole or not at all, and why one cannot be written."""

from collections.abc import Iterable
import errno
import os
from pathlib import Path
import stat
import sys

from checkweigher_core.state_files import replace_file

_UNENCODABLE = 'backslashreplace'  # the name of a file may be no Unicode


class OutputError(ValueError):
    """An output that cannot be written; one line that says which and why."""


def write_whole(path: Path, content: str | bytes | Iterable[str], mode: int = 0o644) -> None:
    """Write a file, in place of one that is there; text in UTF-8, its line ends as they are.

    A text may come in parts, such as the lines of another file. A link stays one: what it names
    is replaced. A stream is written to as it is, see `is_stream`. `mode` is that of the file.

    Raises
    ------
    OutputError
        If it cannot be written; a file that was there before then stays.
    """
    parts = map(_encoded, [content] if isinstance(content, str | bytes) else content)
    try:
        if is_stream(path):
            _write_stream(path, parts)
            return
        target = Path(os.path.realpath(path))
        if target.is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        replace_file(target, parts, mode)
    except OSError as error:
        raise output_error(path, error) from None


def is_stream(path: Path) -> bool:
    """Return whether a path names a device, a pipe or the standard output, also through links.

    There is nothing to replace in them, and a device that a file took the place of is gone.
    """
    try:
        there = os.stat(path)
    except OSError:
        return False
    if stat.S_ISREG(there.st_mode):
        return os.path.samestat(there, os.fstat(1))
    return not stat.S_ISDIR(there.st_mode)


def _encoded(part: str | bytes) -> bytes:
    return part if isinstance(part, bytes) else part.encode('utf-8', _UNENCODABLE)


def _write_stream(path: Path, parts: Iterable[bytes]) -> None:
    if os.path.samestat(os.stat(path), os.fstat(1)):
        sys.stdout.flush()
        number = os.dup(1)
    else:
        # A pipe that nobody reads is an error then; without the flag it would hang.
        number = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        os.set_blocking(number, True)
    with open(number, 'wb') as file:
        file.writelines(parts)


def check_new(path: Path) -> None:
    """Raise OutputError unless a file or folder can be made, before the work for it begins."""
    if os.path.lexists(path):
        raise OutputError(f'{path}: exists already; remove it or choose another name')
    check_folder_of(path)


def check_folder_of(path: Path) -> None:
    """Raise OutputError unless something can be made or replaced where `path` leads."""
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
        raise OutputError(f'{path}: there is no folder {folder}; make it first')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f'{path}: folder {folder} is read-only')


def output_error(path: Path, error: OSError) -> OutputError:
    """Return the one line for an error of the file system."""
    if error.errno == errno.ENXIO:
        return OutputError(f'{path}: cannot be written: nobody reads this pipe')
    return OutputError(f'{path}: cannot be written: {error.strerror or error}')

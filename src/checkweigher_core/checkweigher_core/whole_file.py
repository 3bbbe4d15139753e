# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writing of output files, complete or not at all."""

from collections.abc import Iterable
import errno
import os
from pathlib import Path
import stat
import sys

from checkweigher_core.state_files import replace_file


class OutputError(ValueError):
    """An output that cannot be written. The message names the output and the fault."""


def write_whole(path: Path, content: str | bytes | Iterable[str], mode: int = 0o644) -> None:
    """Write or replace a file. Text is written in UTF-8 with unchanged line ends.

    A text may be given in parts, such as the lines of another file. If the path is a link, its
    target is replaced. A stream (see `is_stream`) is written to, not replaced. `mode` has the
    permissions of the file.

    Raises `OutputError` if the file cannot be written; an old file then stays.
    """
    given = [content] if isinstance(content, str | bytes) else content
    # The name of a file may not be Unicode.
    parts = (p if isinstance(p, bytes) else p.encode(errors='backslashreplace') for p in given)
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
    """Return whether a path or the target of a link is a device, a pipe or the standard output.

    Such a file must not be replaced, because a device would be lost.
    """
    try:
        there = os.stat(path)
    except OSError:
        return False
    if stat.S_ISREG(there.st_mode):
        return os.path.samestat(there, os.fstat(1))
    return not stat.S_ISDIR(there.st_mode)


def _write_stream(path: Path, parts: Iterable[bytes]) -> None:
    if os.path.samestat(os.stat(path), os.fstat(1)):
        sys.stdout.flush()
        number = os.dup(1)
    else:
        # Without the flag, opening a pipe without a reader would hang.
        number = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        os.set_blocking(number, True)
    with open(number, 'wb') as file:
        file.writelines(parts)


def make_output_folder(path: Path, *, exist_ok: bool = False) -> None:
    """Make a folder for outputs; `OutputError` if it cannot be made."""
    try:
        path.mkdir(exist_ok=exist_ok)
    except OSError as error:
        raise output_error(path, error) from None


def check_new(path: Path) -> None:
    """Raise `OutputError` unless a new file or folder can be made; call this before the work."""
    if os.path.lexists(path):
        raise OutputError(f'{path}: exists already; remove it or choose another name')
    check_folder_of(path)


def check_folder_of(path: Path) -> None:
    """Raise `OutputError` unless a file or folder can be made or replaced at a path."""
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
        raise OutputError(f'{path}: there is no folder {folder}; make it first')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f'{path}: folder {folder} is read-only')


def output_error(path: Path, error: OSError) -> OutputError:
    """Return an `OutputError` for an error of the file system."""
    if error.errno == errno.ENXIO:
        return OutputError(f'{path}: cannot be written: nobody reads this pipe')
    return OutputError(f'{path}: cannot be written: {error.strerror or error}')

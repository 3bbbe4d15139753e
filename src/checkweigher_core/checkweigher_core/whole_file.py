# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writing of output files. A file is written completely or not at all."""

from collections.abc import Iterable
import errno
import os
from pathlib import Path
import stat
import sys

from checkweigher_core.state_files import replace_file


class OutputError(ValueError):
    """Raised if an output cannot be written. The message states the path and the reason."""


def write_whole(path: Path, content: str | bytes | Iterable[str], mode: int = 0o644) -> None:
    """Write or replace a file. Text is written in UTF-8 with unchanged line endings.

    If the path is a link, its target is replaced. If the path leads to a stream (see `is_stream`),
    the content is written to the stream, which is not replaced. `mode` contains the permissions of
    the file. If the file cannot be written, `OutputError` is raised, and an existing file is left
    unchanged.
    """
    given = [content] if isinstance(content, str | bytes) else content
    # Replace characters that UTF-8 cannot encode, for example in file names, by escape sequences.
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
    """Return whether a path leads to a device, a pipe or the standard output.

    The result is False if nothing exists at the path. The caller must write to a stream, and must
    not replace it by a regular file.
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
        # With O_NONBLOCK, `open` fails for a pipe that no process reads, instead of waiting.
        number = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        os.set_blocking(number, True)
    with open(number, 'wb') as file:
        file.writelines(parts)


def make_output_folder(path: Path, *, exist_ok: bool = False) -> None:
    """Make a folder for outputs. Raises `OutputError` if the folder cannot be made."""
    try:
        path.mkdir(exist_ok=exist_ok)
    except OSError as error:
        raise output_error(path, error) from None


def check_new(path: Path) -> None:
    """Raise `OutputError` if the path of a new file or folder exists or cannot be created."""
    if os.path.lexists(path):
        raise OutputError(f'{path}: exists already; remove it or choose another name')
    check_folder_of(path)


def check_folder_of(path: Path) -> None:
    """Raise `OutputError` if a file or folder can be neither created nor replaced at a path."""
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
        raise OutputError(f'{path}: there is no folder {folder}; make it first')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f'{path}: folder {folder} is read-only')


def output_error(path: Path, error: OSError) -> OutputError:
    """Return an `OutputError` with the path and the reason of an OSError."""
    if error.errno == errno.ENXIO:
        return OutputError(f'{path}: cannot be written: no process reads this pipe')
    return OutputError(f'{path}: cannot be written: {error.strerror or error}')

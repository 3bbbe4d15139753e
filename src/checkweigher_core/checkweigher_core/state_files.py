# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Paths of state files, which outlive the process of a node, and safe replacement of files.

A file is safely replaced if neither an exception nor a power cut leaves an incomplete file.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import re
import tempfile
from typing import BinaryIO


def state_file(name: str) -> Path:
    """Return the path of a file in $XDG_STATE_HOME/checkweigher or ~/.local/state/checkweigher.

    A character of `name` that is not a letter, a digit, ``_``, ``.`` or ``-`` is replaced by ``_``.

    Raises
    ------
    RuntimeError
        If XDG_STATE_HOME is not set, and the user has no home folder.
    """
    state = os.environ.get('XDG_STATE_HOME') or '~/.local/state'
    return Path(state, 'checkweigher', re.sub(r'[^\w.-]', '_', name)).expanduser()


def replace_file(path: Path, parts: Iterable[bytes], mode: int = 0o644) -> None:
    """Replace a file by the concatenation of `parts`, in the safe way of `replacing`.

    Raises OSError if the file cannot be written.
    """
    with replacing(path, mode) as file:
        file.writelines(parts)


@contextmanager
def replacing(path: Path, mode: int = 0o644) -> Iterator[BinaryIO]:
    """Open a temporary file, and rename it to `path` when the context ends.

    If the body of the ``with`` statement raises an exception, the temporary file is removed, and an
    existing file `path` is left unchanged. A power cut before the context has ended leaves either
    the complete old file or the complete new file. A later power cut leaves the new file. `mode`
    contains the permissions of the new file. Raises OSError if the file cannot be written.
    """
    number, name = tempfile.mkstemp(prefix=f'.{path.name}-', dir=path.parent)
    try:
        with open(number, 'wb') as file:
            yield file
            file.flush()
            os.fchmod(number, mode)
            os.fsync(number)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Flush the entries of a folder to the disk, so that they survive a power cut.

    Raises OSError if the folder cannot be opened or flushed.
    """
    with _opened(path) as folder:
        os.fsync(folder)


def make_folder(path: Path, mode: int = 0o777) -> None:
    """Make a folder and its missing parents, and flush them to the disk.

    `mode` contains the permissions of the folder. The parents get the default permissions. A folder
    that exists is left unchanged. Raises OSError if a folder cannot be made.
    """
    if not path.is_dir():
        make_folder(path.parent)
        path.mkdir(mode, exist_ok=True)
        sync_folder(path.parent)


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """Lock the folder of a file until the context ends.

    Another process that calls this function for a file in the folder waits until the context ends.
    The body of the ``with`` statement can therefore read, change and write the file. Raises OSError
    if the folder cannot be opened.
    """
    with _opened(path.parent) as folder:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield number
    finally:
        os.close(number)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Temporary folders for copies of bags.

The folder of a killed process is removed when another process creates a temporary folder.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import fcntl
import os
from pathlib import Path
import shutil
import tempfile

_PREFIX = 'checkweigher-bag-'


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Create a temporary folder, yield its path, and remove the folder when the context ends.

    The process holds a lock on its folder. The kernel releases the lock when the process ends, so
    `remove_abandoned` can recognize the folders of killed processes. The folders of killed
    processes are removed before the new folder is created, if the file system supports locks.
    """
    remove_abandoned()
    folder, lock = _locked_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def remove_abandoned() -> None:
    """Remove the folders of `scratch_folder` whose processes have ended without removing them.

    Folders of other users are kept. All folders are kept if the file system does not support locks.
    """
    for folder in Path(tempfile.gettempdir()).glob(f'{_PREFIX}*'):
        try:
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:  # the folder belongs to another user, or was removed meanwhile
            continue
        with suppress(OSError):  # the folder is in use, or the file system does not support locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(lock).st_uid == os.getuid():
                shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _locked_folder() -> tuple[Path, int]:
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
        try:
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:  # another process removed the folder before it was locked
            continue
        with suppress(OSError):  # some file systems do not support locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        if folder.exists():
            return folder, lock
        os.close(lock)

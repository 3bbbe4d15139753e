# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a node keeps what outlives its process, and how a file is replaced."""

from collections.abc import Iterable
import os
from pathlib import Path
import re
import tempfile


def state_file(name: str) -> Path:
    """Return a file in $XDG_STATE_HOME/checkweigher, or ~/.local/state/checkweigher.

    Raises
    ------
    RuntimeError
        If the user has no home folder.
    """
    state = os.environ.get('XDG_STATE_HOME') or '~/.local/state'
    return Path(state, 'checkweigher', re.sub(r'[^\w.-]', '_', name)).expanduser()


def sync_folder(folder: Path) -> None:
    """Write the names in a folder to the disk: the file of a name that is not there is lost."""
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def replace_file(path: Path, parts: Iterable[bytes], mode: int = 0o644) -> None:
    """Write a file whole, in place of one that is there; OSError leaves that one as it is.

    The new one is on the disk before it takes the place, so a power cut leaves one of both.
    """
    number, name = tempfile.mkstemp(prefix=f'.{path.name}-', dir=path.parent)
    try:
        with open(number, 'wb') as file:
            file.writelines(parts)
            file.flush()
            os.fchmod(number, mode)
            os.fsync(number)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
    sync_folder(path.parent)

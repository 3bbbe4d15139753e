# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that appear under their name whole or not at all, and why one cannot be written."""

import os
from pathlib import Path
import tempfile


class OutputError(ValueError):
    """An output that cannot be written; one line that says which and why."""


def write_whole(path: Path, text: str) -> None:
    """Write a text file in UTF-8, in place of one that is there; its line ends stay as they are.

    Raises
    ------
    OutputError
        If it cannot be written; what was there before then stays.
    """
    try:
        number, name = tempfile.mkstemp(prefix=f'.{path.name}-', dir=path.parent)
        try:
            with open(number, 'w', encoding='utf-8', newline='') as file:
                file.write(text)
            os.chmod(name, 0o644)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
    except OSError as error:
        raise output_error(path, error) from None


def check_new(path: Path) -> None:
    """Raise OutputError unless a file or folder can be made, before the work for it begins."""
    if os.path.lexists(path):
        raise OutputError(f'{path}: exists already; remove it or choose another name')
    check_folder_of(path)


def check_folder_of(path: Path) -> None:
    """Raise OutputError unless something can be made or replaced beside what `path` names."""
    if not path.parent.is_dir():
        raise OutputError(f'{path}: there is no folder {path.parent}; make it first')
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f'{path}: folder {path.parent} is read-only')


def output_error(path: Path, error: OSError) -> OutputError:
    """Return the one line for an error of the file system."""
    return OutputError(f'{path}: cannot be written: {error.strerror or error}')

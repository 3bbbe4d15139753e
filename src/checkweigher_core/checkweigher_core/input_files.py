# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading of input files whose paths come from the user, and digests of files."""

import errno
import hashlib
from pathlib import Path


def read_input(path: Path) -> bytes:
    """Return the content of a regular file.

    Raises OSError if the file cannot be read, or for a pipe or a device, because reading might
    never end.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, 'not a regular file; copy it to a regular file', str(path))
    return path.read_bytes()


def sha256_of(path: Path) -> str:
    """Return the hexadecimal SHA-256 digest of a file.

    Raises OSError if the file cannot be read.
    """
    with path.open('rb') as file:
        return hashlib.file_digest(file, 'sha256').hexdigest()

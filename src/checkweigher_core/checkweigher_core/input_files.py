# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading of input files that the user names."""

import errno
from pathlib import Path


def read_input(path: Path) -> bytes:
    """Return the content of a file.

    Raises OSError if the file cannot be read, or is a pipe or a device, which may have no end.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, 'not a regular file; copy it to a regular file', str(path))
    return path.read_bytes()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Digest of a bag, which is stored with the results of the bag and identifies its content."""

import hashlib
from pathlib import Path

from checkweigher_recording.archive.copying import holds_bag
from checkweigher_recording.bags.definitions import BagError, bag_errors


def bag_digest(path: Path) -> str:
    """Return the SHA-256 digest of a bag, which does not depend on the path of the bag.

    The digest of a folder includes the name, the size and the content of each file, but not the
    subfolders. The digest of a single file includes only its content.

    Raises `BagError` if there is no bag at `path`, or the bag cannot be read.
    """
    digest = hashlib.sha256()
    if not path.is_dir() and not path.is_file():
        raise BagError(f'{path}: there is no such file or folder')
    with bag_errors(path):
        files = sorted(filter(Path.is_file, path.iterdir())) if path.is_dir() else []
        if path.is_dir() and not holds_bag(file.name for file in files):
            raise BagError(f'{path}: no bag in this folder')
        for file in files or [path]:
            if files:
                digest.update(f'{file.name}\n{file.stat().st_size}\n'.encode())
            with file.open('rb') as content:
                hashlib.file_digest(content, lambda: digest)
    return digest.hexdigest()

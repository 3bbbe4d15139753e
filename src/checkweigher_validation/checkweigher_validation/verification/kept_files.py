# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the files of a verification with the audit log."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from checkweigher_core.input_files import sha256_of
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.results import mcap_digest


def verification_faults(folder: Path, values: Any) -> Iterator[str]:
    """Yield a sentence for each file of a verification that its audit log entry does not confirm.

    `values` is the content of the entry. The entry contains the digest of the bag under the key
    'bag', and the digests of the other files by file name. `folder` contains the bag and the other
    files.
    """
    what = f'verification {folder.name}'
    if not isinstance(values, dict):
        yield f'{what}: its entry in the audit log cannot be used'
        return
    try:
        if mcap_digest(folder / 'bag') != values.get('bag'):
            yield f'{what}: its bag is not as it was'
    except BagError:
        yield f'{what}: its bag is missing'
    yield from file_faults(folder, what, {n: v for n, v in values.items() if '.' in n})


def file_faults(folder: Path, what: str, files: Any) -> Iterator[str]:
    """Yield a sentence for each file that is missing or has another SHA-256 digest than stated.

    `files` contains the hexadecimal digests by file name, and `what` begins each sentence. Nothing
    is yielded if `files` is not a dict.
    """
    for name, digest in files.items() if isinstance(files, dict) else ():
        path = folder / Path(name).name
        if not path.is_file():
            yield f'{what}: {path.name} is missing'
        elif sha256_of(path) != digest:
            yield f'{what}: {path.name} is not as it was'

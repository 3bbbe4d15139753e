# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader for the recorded results of a line."""

import hashlib
from itertools import chain
from pathlib import Path
from typing import Any

from checkweigher_core.ros.ports import Port
from checkweigher_recording.bags.definitions import BagError, definitions_of, deserialize
from checkweigher_recording.bags.lanes import lanes_of
from checkweigher_recording.bags.reading import open_bag


def read_records(path: Path, *wanted: Port) -> dict[str, list[Any]]:
    """Return the records of the `wanted` topics of an MCAP bag, by topic name and in log order.

    The list of a topic without messages is empty.

    Raises `BagError` if the bag is damaged or is not a complete MCAP bag, or if a topic occurs in
    several lanes. Raises `BagError` as well if the message definitions of the bag differ from the
    installed ones by more than fields that were added later.
    """
    found: dict[str, list[Any]] = {port.name: [] for port in wanted}
    files_of_bag(path)
    with open_bag(path) as bag:
        pairs = list(chain(*lanes_of(bag.connections, wanted).values()))
        if len({port.name for _, port in pairs}) < len(pairs):
            raise BagError(f'{path}: holds several lanes; record only one lane')
        ports = {
            connection.id: (port, definitions_of(path, connection, port))
            for connection, port in pairs
        }
        # Do not call `messages` with an empty list, for which rosbags would return all messages.
        messages = bag.messages([connection for connection, _ in pairs]) if pairs else ()
        for connection, _, data in messages:
            port, store = ports[connection.id]
            found[port.name].append(deserialize(port, data, store))
    return found


def files_of_bag(path: Path) -> list[Path]:
    """Return the MCAP files of a bag, sorted by name.

    Raises `BagError` if `path` is not the folder of a complete MCAP bag.
    """
    files = sorted(path.glob('*.mcap')) if path.is_dir() else []
    if not files or not (path / 'metadata.yaml').is_file():
        raise BagError(f'{path}: not the folder of a whole MCAP bag')
    return files


def mcap_digest(path: Path) -> str:
    """Return the SHA-256 digest of the contents of a bag's MCAP files, in hexadecimal digits.

    The files are read in the order of their names. Raises `BagError` as `files_of_bag` does.
    """
    digest = hashlib.sha256()
    for file in files_of_bag(path):
        with file.open('rb') as content:
            hashlib.file_digest(content, lambda: digest)
    return digest.hexdigest()

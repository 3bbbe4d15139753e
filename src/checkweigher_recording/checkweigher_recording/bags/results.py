# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading what a line made of its signal: records of any ports of a bag in log order."""

import hashlib
from pathlib import Path
from typing import Any

from rosbags.typesys.store import Typestore

from checkweigher_core.ros.ports import Port
from checkweigher_recording.bags.definitions import BagError, definitions_of, deserialize
from checkweigher_recording.bags.lanes import find_port
from checkweigher_recording.bags.reading import open_bag


def read_records(path: Path, *wanted: Port) -> dict[str, list[Any]]:
    """Return the records of ports of a whole MCAP bag by the name of the port, in log order.

    Raises
    ------
    BagError
        If the bag is damaged or foreign, or holds one of the ports for several lanes.
    """
    found: dict[str, list[Any]] = {port.name: [] for port in wanted}
    files_of_bag(path)
    with open_bag(path) as bag:
        ports: dict[str, Port] = {}  # by topic
        stores: dict[int, Typestore] = {}  # by connection
        for connection in bag.connections:
            known = find_port(connection.topic, wanted)
            if known is None:
                continue
            if known[1] in ports.values():
                raise BagError(f'{path}: holds several lanes; record one')
            stores[connection.id] = definitions_of(path, connection, known[1])
            ports[connection.topic] = known[1]
        chosen = [each for each in bag.connections if each.topic in ports]
        # Of no connections rosbags would give all messages.
        for connection, _, data in bag.messages(chosen) if chosen else ():
            port = ports[connection.topic]
            found[port.name].append(deserialize(port, data, stores[connection.id]))
    return found


def files_of_bag(path: Path) -> list[Path]:
    """Return the MCAP files of a bag in the order of their names; BagError if there are none."""
    files = sorted(path.glob('*.mcap')) if path.is_dir() else []
    if not files or not (path / 'metadata.yaml').is_file():
        raise BagError(f'{path}: not the folder of a whole MCAP bag')
    return files


def mcap_digest(path: Path) -> str:
    """Return the SHA-256 over the MCAP files of a bag."""
    digest = hashlib.sha256()
    for file in files_of_bag(path):
        with file.open('rb') as content:
            hashlib.file_digest(content, lambda: digest)
    return digest.hexdigest()

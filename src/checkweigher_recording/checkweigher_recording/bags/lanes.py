# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The lanes of a bag: a lane's topics are those below its namespace."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from rosbags.interfaces import Connection

from checkweigher_core.ros.ports import LOAD_CELL_SAMPLES, PLAYED, Port
from checkweigher_recording.bags.definitions import BagError

Lane = list[tuple[Connection, Port]]


def lane_prefix(namespace: str) -> str:
    """Return what precedes the names of a lane's topics, however its slashes were written."""
    return ''.join(f'/{part}' for part in namespace.split('/') if part)


def find_port(name: str, ports: Iterable[Port]) -> tuple[str, Port] | None:
    """Return the lane and the port of a topic, None for a topic of no port."""
    name = f'/{name.lstrip("/")}'
    found = [
        port
        for port in ports
        if (name == port.name if port.name.startswith('/') else name.endswith(f'/{port.name}'))
    ]
    if not found:
        return None
    # The longest: load_cell/status is not the status of a lane called load_cell.
    port = max(found, key=lambda port: len(port.name))
    return name.removesuffix(port.name).removesuffix('/'), port


def choose_lane(path: Path, connections: Sequence[Connection], namespace: str | None) -> Lane:
    """Return those connections of one lane that describe a recording, each with its port.

    Raises
    ------
    BagError
        If there is no such lane, or several and no namespace.
    """
    lanes: dict[str, Lane] = {}
    for connection in connections:
        if found := find_port(connection.topic, PLAYED):
            prefix, port = found
            lanes.setdefault(prefix, []).append((connection, port))
    if not lanes:
        names = ', '.join(sorted({connection.topic for connection in connections})) or 'none'
        raise BagError(
            f'{path}: not of a checkweigher: no topic {LOAD_CELL_SAMPLES.name}; its topics are: '
            f'{names}'
        )
    if namespace is None and len(lanes) == 1:
        return next(iter(lanes.values()))
    listed = ', '.join(prefix or '/' for prefix in sorted(lanes))
    if namespace is None:
        raise BagError(f'{path}: holds several lanes: {listed}; choose one by its namespace')
    prefix = lane_prefix(namespace)
    if prefix not in lanes:
        raise BagError(f'{path}: has no lane {prefix or "/"}; it has {listed}')
    return lanes[prefix]

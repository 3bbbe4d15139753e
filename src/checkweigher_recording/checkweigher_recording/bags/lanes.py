# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes of a bag. A lane is one checkweigher, whose topics have a namespace in common."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from rosbags.interfaces import Connection

from checkweigher_core.ros.ports import LOAD_CELL_SAMPLES, PLAYED, Port
from checkweigher_recording.bags.definitions import BagError

Lane = list[tuple[Connection, Port]]


def lane_prefix(namespace: str) -> str:
    """Return the prefix of the topic names in a namespace, such as ``/left`` for ``left/``.

    The prefix of the empty namespace is empty.
    """
    return ''.join(f'/{part}' for part in namespace.split('/') if part)


def find_port(name: str, ports: Iterable[Port]) -> tuple[str, Port] | None:
    """Return the lane prefix and the port of a topic, or None if the topic belongs to no port."""
    name = f'/{name.lstrip("/")}'
    found = [port for port in ports if name == port.name or name.endswith(f'/{port.name}')]
    if not found:
        return None
    # Choose the port with the longest name, because the topic load_cell/status would otherwise be
    # taken for the topic status of a lane with the namespace load_cell.
    port = max(found, key=lambda port: len(port.name))
    return name.removesuffix(port.name).removesuffix('/'), port


def lanes_of(connections: Iterable[Connection], ports: Collection[Port]) -> dict[str, Lane]:
    """Return the pairs (connection, port) of each lane that has topics of `ports`, by lane prefix.

    Connections with other topics are left out. A port whose name is absolute, such as
    ``/diagnostics``, has the empty lane prefix, because it belongs to all lanes.
    """
    lanes: dict[str, Lane] = {}
    for connection in connections:
        if found := find_port(connection.topic, ports):
            prefix, port = found
            lanes.setdefault(prefix, []).append((connection, port))
    return lanes


def choose_lane(path: Path, connections: Sequence[Connection], namespace: str | None) -> Lane:
    """Return the connections of a lane whose topics a replay reads, each with its port.

    `namespace` is the namespace of the lane, or None for the only lane of the bag.

    Raises `BagError` if the bag has no such lane, or if `namespace` is None and the bag has several
    lanes.
    """
    lanes = lanes_of(connections, PLAYED)
    if not lanes:
        names = ', '.join(sorted({connection.topic for connection in connections})) or 'none'
        raise BagError(
            f'{path}: is not a recording of a checkweigher, because it has no topic such as '
            f'{LOAD_CELL_SAMPLES.name}; its topics are {names}'
        )
    listed = ', '.join(each or '/' for each in sorted(lanes))
    prefix, *others = lanes if namespace is None else (lane_prefix(namespace),)
    if others:
        raise BagError(f'{path}: holds several lanes: {listed}; choose one by its namespace')
    if prefix not in lanes:
        raise BagError(f'{path}: has no lane {prefix or "/"}; it has {listed}')
    return lanes[prefix]

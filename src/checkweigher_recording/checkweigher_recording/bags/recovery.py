# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recovery of a recording that broke off: a whole bag of the messages that are there."""

from pathlib import Path

from checkweigher_core.ros.ports import RECORDED, Port
from checkweigher_recording.bags.definitions import BagError, bag_errors, check_definition
from checkweigher_recording.bags.lanes import find_port
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts
from checkweigher_recording.bags.writing import BagWriter


def recover_bag(source: Path, path: Path) -> int:
    """Write a new bag of all messages up to where a recording was cut; return their number.

    `source` is an ``.mcap`` file without an end, or the folder of a recording that broke off. Of a
    chunk with a wrong check sum nothing is taken, nor of anything behind it.

    Raises
    ------
    BagError
        If there is no message of a checkweigher in it, if they are of several lanes, or if they
        have other definitions than those that are installed here.
    OutputError
        If the bag cannot be written.
    """
    parts = unfinished_parts(source) or [source]
    if not parts[0].is_file():
        raise BagError(f'{source}: there is no .mcap file and no recording that broke off')
    with bag_errors(source):
        bag = UnfinishedBag(parts)
    ports: dict[str, Port] = {}  # by the name of the topic
    lanes: set[str] = set()
    connections = []
    for connection in bag.connections:
        found = find_port(connection.topic, RECORDED)
        if found is None or not connection.msgcount:
            continue
        prefix, port = found
        check_definition(source, connection, port)
        ports[connection.topic] = port
        connections.append(connection)
        # A topic that nodes of all lanes share is of no lane.
        if not port.name.startswith('/'):
            lanes.add(prefix)
    if len(lanes) != 1:
        what = 'holds several lanes' if lanes else 'no message of a checkweigher can be read'
        raise BagError(f'{source}: {what}; there is nothing to recover')
    written = list({port.name: port for port in ports.values()}.values())
    with BagWriter(path, written, lanes.pop()) as whole:
        for connection, log_time, data in bag.messages(connections):
            whole.put(ports[connection.topic], log_time, data)
        return whole.message_count

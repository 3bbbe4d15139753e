# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recovery of the readable messages of an incomplete recording."""

from collections.abc import Mapping
from itertools import chain
from pathlib import Path

from checkweigher_core.ros.ports import RECORDED
from checkweigher_recording.bags.definitions import BagError, bag_errors, check_definition
from checkweigher_recording.bags.lanes import Lane, lanes_of
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts
from checkweigher_recording.bags.writing import BagWriter


def recover_bag(source: Path, path: Path) -> int:
    """Copy the readable messages of an incomplete recording to a new bag; return their number.

    `source` is an ``.mcap`` file whose end is missing, or the folder of a recording whose process
    was killed. Only messages of the topics `RECORDED` are copied, and only those before the first
    fault, such as a chunk with a wrong check sum.

    Raises `BagError` if `source` does not exist or cannot be read, has no messages of a
    checkweigher, has messages of several lanes, or has messages whose definitions differ from the
    installed ones. Raises `OutputError` if `path` exists already or cannot be written.
    """
    parts = unfinished_parts(source) or [source]
    if not parts[0].is_file():
        raise BagError(f'{source}: there is no .mcap file and no recording that broke off')
    with bag_errors(source):
        bag = UnfinishedBag(parts)
    found = lanes_of((each for each in bag.connections if each.msgcount), RECORDED)
    lane = _only_lane(source, found)
    ports = {connection.topic: port for connection, port in chain(*found.values())}
    for connection, port in chain(*found.values()):
        check_definition(source, connection, port)
    connections = [each for each in bag.connections if each.topic in ports]
    written = list({port.name: port for port in ports.values()}.values())
    with BagWriter(path, written, lane) as whole:
        for connection, log_time, data in bag.messages(connections):
            whole.put(ports[connection.topic], log_time, data)
        return whole.message_count


def _only_lane(source: Path, found: Mapping[str, Lane]) -> str:
    """Return the prefix of the only lane.

    Topics with absolute names are ignored, because they belong to all lanes.

    Raises `BagError` if there is no lane, or more than one.
    """
    lanes = [
        lane
        for lane, pairs in found.items()
        if not all(port.name.startswith('/') for _, port in pairs)
    ]
    if len(lanes) != 1:
        what = 'holds several lanes' if lanes else 'no message of a checkweigher can be read'
        raise BagError(f'{source}: {what}; it cannot be recovered')
    return lanes[0]

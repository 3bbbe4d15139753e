# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Places of nodes, so that each node of a lane runs only once on this computer.

A place is a name in the abstract namespace of Unix sockets. The kernel gives it to one process and
frees it when that process ends, even by a kill. No file stays behind, or can be removed while the
line runs. A place has the reach of DDS on localhost: one network namespace, all users.
"""

import errno
from hashlib import blake2b
import socket
from typing import Any
from uuid import uuid4

from diagnostic_msgs.msg import KeyValue
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node

from checkweigher_core.parameters import ParameterError

PARTICIPANT = 12  # bytes of a gid that all endpoints of a process share: the RTPS GUID prefix


class Place:
    """The place of a node, held until `free` or the end of the process.

    `name` is the full name of the node in the ROS `domain`. After `sign`, `is_held` can tell this
    process from another one that claims to be the node.

    Raises
    ------
    ParameterError
        If another node holds it.
    """

    def __init__(self, domain: int, name: str) -> None:
        self._domain, self._name = domain, name
        self._sockets: list[socket.socket] = []
        if not self._hold(b''):
            raise ParameterError(
                f'{name} runs here already, in ROS_DOMAIN_ID {domain}; stop it, or choose another '
                'namespace or ROS_DOMAIN_ID'
            )

    def sign(self, participant: bytes) -> None:
        """Register the DDS participant by which the graph shows the node of this place."""
        self._hold(participant)

    def free(self) -> None:
        """Release the place."""
        for each in self._sockets:
            each.close()

    def _hold(self, participant: bytes) -> bool:
        holder = _socket()
        self._sockets.append(holder)
        try:
            holder.bind(_address(self._domain, self._name, participant))
        except OSError as error:
            # A system without such names has no places; only the graph tells its lines apart.
            return error.errno != errno.EADDRINUSE
        return True


def participant_of(node: Node) -> bytes:
    """Return the DDS participant by which the graph shows the nodes of this process."""
    events = PublisherEventCallbacks(use_default_callbacks=False)
    publisher = node.create_publisher(KeyValue, f'~/_{uuid4().hex}', 1, event_callbacks=events)
    (own,) = node.get_publishers_info_by_topic(publisher.topic_name)
    node.destroy_publisher(publisher)
    return bytes(own.endpoint_gid)[:PARTICIPANT]


def is_held(domain: int, name: str, participant: bytes = b'') -> bool:
    """Return whether a node holds its place and, if given, has signed as this participant."""
    with _socket() as probe:
        return probe.connect_ex(_address(domain, name, participant)) == 0


def _socket() -> socket.socket:
    return socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)


def _address(domain: int, name: str, participant: bytes) -> str:
    text = f'{domain} {name} {participant.hex()}'  # may exceed the 107 bytes of an address
    return f'\0checkweigher/{blake2b(text.encode(), digest_size=20).hexdigest()}'


def full_name(endpoint: Any) -> str:
    """Return the full name of the node of an endpoint."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Places of nodes, which ensure that each node of a lane runs only once on a computer.

A place is a name in the abstract namespace of Unix sockets, to which only one process can bind a
socket. The kernel releases the name when the process ends, even if the process is killed. All users
in a network namespace share the names of places, as they share DDS on localhost.
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

PARTICIPANT = 12  # length in bytes of the RTPS GUID prefix, which all endpoints of a process share


class Place:
    """Place of a node, which is held until `free` is called or the process ends.

    `name` is the full name of the node, and `domain` is its ROS domain. After a call of `sign`,
    `is_held` can distinguish this node from a node of the same name in another process.

    Raises
    ------
    ParameterError
        If another node holds the place.
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
        """Register the GUID prefix of the DDS participant to which the node belongs."""
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
            # An error other than EADDRINUSE means that the system has no abstract names. Continue
            # without a place.
            return error.errno != errno.EADDRINUSE
        return True


def participant_of(node: Node) -> bytes:
    """Return the GUID prefix of the DDS participant of this process."""
    events = PublisherEventCallbacks(use_default_callbacks=False)
    publisher = node.create_publisher(KeyValue, f'~/_{uuid4().hex}', 1, event_callbacks=events)
    (own,) = node.get_publishers_info_by_topic(publisher.topic_name)
    node.destroy_publisher(publisher)
    return bytes(own.endpoint_gid)[:PARTICIPANT]


def is_held(domain: int, name: str, participant: bytes = b'') -> bool:
    """Return whether a node holds its place.

    If `participant` is given, also check that the node has registered this GUID prefix.
    """
    with _socket() as probe:
        return probe.connect_ex(_address(domain, name, participant)) == 0


def _socket() -> socket.socket:
    return socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)


def _address(domain: int, name: str, participant: bytes) -> str:
    # Hash the text, because an address has at most 107 bytes, and the text may be longer.
    text = f'{domain} {name} {participant.hex()}'
    return f'\0checkweigher/{blake2b(text.encode(), digest_size=20).hexdigest()}'


def full_name(endpoint: Any) -> str:
    """Return the full name of the node of an endpoint."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hosts of the nodes in the graph, by the identity of their endpoints and by their supervisors."""

from collections.abc import Iterable
from typing import Any

from rclpy.node import Node

from checkweigher_dsp.health.host_clocks import SUPERVISOR
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.graph.place import PARTICIPANT

_FAST_DDS, _HOST = b'\x01\x0f', 4  # vendor of a gid (RTPS 2.5, 9.3.1.5); bytes with the host


def host_of(gid: bytes) -> bytes:
    """Return what all endpoints of a host have in common.

    Fast DDS has a number of the host in each gid, made of its addresses, by which it also tells
    whom shared memory reaches. Of other implementations of DDS each process is a host.
    """
    return gid[:_HOST] if gid.startswith(_FAST_DDS) else gid[:PARTICIPANT]


def supervised_hosts(node: Node) -> dict[bytes, str]:
    """Return the hosts that have one supervisor, with the names of these in the description.

    Two hosts of one name have none, nor has one of two names.
    """
    return _supervised(_reporting(node))


def hosts_of_lanes(node: Node) -> dict[str, set[str]]:
    """Return the names of the hosts on which nodes of each lane run, where they are known."""
    listed = _reporting(node)
    names = _supervised(listed)
    found: dict[str, set[str]] = {}
    for each in listed:
        host = names.get(host_of(bytes(each.endpoint_gid)))
        if host is not None and each.node_name in ports.NODES:
            found.setdefault(each.node_namespace.strip('/'), set()).add(host)
    return found


def _reporting(node: Node) -> list[Any]:
    return list(node.get_publishers_info_by_topic(ports.DIAGNOSTICS.name))


def _supervised(listed: Iterable[Any]) -> dict[bytes, str]:
    pairs = {
        (host_of(bytes(each.endpoint_gid)), each.node_name.removeprefix(SUPERVISOR))
        for each in listed
        if each.node_name.startswith(SUPERVISOR)
    }
    hosts, names = [host for host, _ in pairs], [name for _, name in pairs]
    return {h: n for h, n in pairs if hosts.count(h) == names.count(n) == 1}

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Strangers: other nodes that publish a topic of a node of the line."""

from collections.abc import Iterable

from rclpy.node import Node

from checkweigher_core.health.findings import Finding, conclude, error_if
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.place import full_name

_WATCHED = tuple(port for port in ports.ALL if port.maker in ports.NODES)
_UNNAMED = '_NODE_NAME_UNKNOWN_'  # name of an endpoint that DDS finds before its node


def strangers(publishers: Iterable[str], maker: str) -> list[str]:
    """Return the names of publishers of a topic other than its `maker`.

    A single name counts as the maker. Endpoints are not counted, because DDS lists a killed maker
    beside its successor until its lease ends.
    """
    names = set(publishers)
    return sorted(names - {maker}) if len(names) > 1 else []


class StrangerWatch:
    """Watch of the publishers of the topics of a node.

    Attributes
    ----------
    found : str
        Strangers at the last look, each with its topics; empty if there are none.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        space = node.get_namespace().rstrip('/')
        self._makers = {
            node.resolve_topic_name(port.name): f'{space}/{port.maker}' for port in _WATCHED
        }
        self.found = ''

    def look(self) -> str:
        """Read the present publishers from the graph, and return the strangers."""
        topics: dict[str, list[str]] = {}
        for topic, maker in self._makers.items():
            if self._node.count_publishers(topic) < 2:  # faster than reading their names
                continue
            listed = self._node.get_publishers_info_by_topic(topic)
            names = [full_name(each) for each in listed if each.node_name != _UNNAMED]
            for name in strangers(names, maker):
                topics.setdefault(name, []).append(topic)
        self.found = '; '.join(f'{name} publishes {", ".join(t)}' for name, t in topics.items())
        return self.found

    def finding(self) -> Finding:
        """Return the aspect Publishers."""
        concern = error_if(bool(self.found), self.found, Reason.FOREIGN_PUBLISHER.hint)
        return conclude('Publishers', 'each topic of the line has one maker', [concern])

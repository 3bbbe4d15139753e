# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Detection of strangers, which are nodes that publish a topic of another node of the line."""

from collections.abc import Iterable

from rclpy.node import Node

from checkweigher_core.health.findings import Finding, conclude, error_if
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.place import full_name

_WATCHED = tuple(port for port in ports.ALL if port.maker in ports.NODES)
_UNNAMED = '_NODE_NAME_UNKNOWN_'  # node name of a publisher whose node is not known yet


def strangers(publishers: Iterable[str], maker: str) -> list[str]:
    """Return the names of the nodes, other than `maker`, that publish a topic of `maker`.

    If all publishers have the same name, there is no stranger, even if the name is not `maker`.
    Several publishers of one name are permitted, because DDS lists the publisher of a killed node
    until its lease ends.
    """
    names = set(publishers)
    return sorted(names - {maker}) if len(names) > 1 else []


class StrangerWatch:
    """Watch of the publishers of the topics of a line."""

    def __init__(self, node: Node) -> None:
        self._node = node
        space = node.get_namespace().rstrip('/')
        self._makers = {
            node.resolve_topic_name(port.name): f'{space}/{port.maker}' for port in _WATCHED
        }
        self.found = ''  # strangers of the last check with their topics, or empty

    def look(self) -> str:
        """Return a text with the strangers and the topics that they publish.

        The text is empty if there are no strangers.
        """
        topics: dict[str, list[str]] = {}
        for topic, maker in self._makers.items():
            # Read the names only if there are several publishers, because counting is faster.
            if self._node.count_publishers(topic) < 2:
                continue
            listed = self._node.get_publishers_info_by_topic(topic)
            names = [full_name(each) for each in listed if each.node_name != _UNNAMED]
            for name in strangers(names, maker):
                topics.setdefault(name, []).append(topic)
        self.found = '; '.join(f'{name} publishes {", ".join(t)}' for name, t in topics.items())
        return self.found

    def finding(self) -> Finding:
        """Return the finding on the strangers that `look` found last (aspect Publishers)."""
        concern = error_if(bool(self.found), self.found, Reason.FOREIGN_PUBLISHER.hint)
        return conclude('Publishers', 'each topic of the line has one publisher', [concern])

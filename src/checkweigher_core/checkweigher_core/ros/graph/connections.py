# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Monitoring of the connections of a node: missing endpoints and incompatible QoS."""

from collections.abc import Iterator
from typing import Any

from rclpy.node import Node

from checkweigher_core.health.findings import Concern, Finding, Level, RecentValues, conclude
from checkweigher_core.ros.graph.place import full_name
from checkweigher_core.ros.outputs import Input, Output
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import Port, fits, misfit

_PATIENCE = 5.0  # longest time in s that the nodes of a line need to discover each other


class Connections:
    """Monitor of the inputs and outputs of a node.

    The node was started at time `began` in s on a monotonic clock.
    """

    def __init__(self, node: PortNode, began: float) -> None:
        self._node = node
        self._began = began
        self._refused = RecentValues()
        self._refusal = ''
        self._logged: set[str] = set()  # warnings about incompatible QoS that were logged

    def refused(self, now: float, name: str, why: str) -> None:
        """Count a message of the topic `name` that was refused at time `now` in s.

        `now` is on the clock of `began`, and `why` is the reason for the refusal.
        """
        self._refused.add(now, 1.0)
        self._refusal = f'{name}: {why}'

    def lacks_input(self, port: Port) -> bool:
        """Return whether the node has an input for a port, but the port has no publisher."""
        return any(entry.port is port and not entry.count() for entry in self._node.inputs)

    def finding(self, now: float) -> Finding:
        """Return the finding "Connections" at time `now` in s on the clock of `began`."""
        self._refused.forget(now)
        values: dict[str, float | str] = {}
        found: list[Concern] = []
        ends: list[Input | Output] = [*self._node.inputs, *self._node.outputs]
        for end in ends:
            count, partner = end.count(), _partner(end)
            other = 'publisher' if isinstance(end, Input) else 'subscriber'
            if partner:
                values[f'{end.port.name} {other}s'] = count
            found += self._clashes(end, needed=bool(partner) and count == 0)
            if partner and count == 0 and now - self._began > _PATIENCE:
                level = Level.ERROR if isinstance(end, Input) else Level.WARN
                hint = f'check that {partner} runs, in this namespace and ROS_DOMAIN_ID'
                found.append(Concern(level, f'no {other} of {end.topic_name}', hint))
        values['messages refused in the last minute'] = len(self._refused)
        if len(self._refused):
            text = f'{len(self._refused)} messages refused in the last minute: {self._refusal}'
            hint = 'check which node publishes this topic, and its message version'
            found.append(Concern(Level.WARN, text, hint))
        return conclude('Connections', 'all connected', found, values)

    def _clashes(self, end: Input | Output, *, needed: bool) -> Iterator[Concern]:
        """Yield a concern for each endpoint at the other end that has an incompatible QoS.

        The concern is an error if `needed` is true, otherwise a warning. Each concern is logged
        once.
        """
        is_input = isinstance(end, Input)
        for other in self._others(end):
            pair = (other.qos_profile, end.qos) if is_input else (end.qos, other.qos_profile)
            if why := misfit(*pair):
                who = full_name(other)
                does = 'publishes' if is_input else 'subscribes to'
                text = f'{who} {does} {end.topic_name} with an incompatible QoS ({why})'
                if text not in self._logged:
                    self._logged.add(text)
                    self._node.get_logger().warning(text)
                yield Concern(
                    Level.ERROR if needed else Level.WARN,
                    text,
                    f'change the QoS of {who} to that of docs/topics.md',
                )

    def _others(self, end: Input | Output) -> list[Any]:
        """Return the endpoints at the other end, or an empty list if all are connected.

        The list is also empty for an input whose records are passed by function calls.
        """
        node, name = self._node, end.topic_name
        if isinstance(end, Output):
            if node.count_subscribers(name) <= end.publisher.get_subscription_count():
                return []
            return list(node.get_subscriptions_info_by_topic(name))
        if end.subscription is None or node.count_publishers(name) <= end.count():
            return []
        return list(node.get_publishers_info_by_topic(name))


def has_matched_all(node: Node, *outputs: Output) -> bool:
    """Return whether all `outputs` are connected to all compatible subscribers in the ROS graph."""
    return all(
        output.publisher.get_subscription_count()
        >= sum(
            other.topic_type == output.port.message_type and fits(output.qos, other.qos_profile)
            for other in node.get_subscriptions_info_by_topic(output.topic_name)
        )
        for output in outputs
    )


def _partner(end: Input | Output) -> str:
    """Return the names of the nodes that are required at the other end of an input or output.

    The result is empty if no node is required.
    """
    port = end.port
    if isinstance(end, Input):
        return port.maker if end.needed and port.maker in port.expected else ''
    return ' and '.join(taker for taker in port.takers if taker in port.expected)

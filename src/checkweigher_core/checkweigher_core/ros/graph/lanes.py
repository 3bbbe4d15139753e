# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search for the running lanes in the ROS graph."""

from rclpy.node import Node

from checkweigher_core.ros import ports


def running_lanes(node: Node) -> set[str]:
    """Return the namespaces, without leading slashes, in which verdicts are published.

    A topic of verdicts without a publisher does not count, because the command `run` subscribes to
    it before the nodes of the lane start.
    """
    kind, ending = ports.VERDICT.message_type, f'/{ports.VERDICT.name}'
    return {
        topic.removesuffix(ending).strip('/')
        for topic, kinds in node.get_topic_names_and_types()
        if topic.endswith(ending) and kind in kinds and node.count_publishers(topic)
    }

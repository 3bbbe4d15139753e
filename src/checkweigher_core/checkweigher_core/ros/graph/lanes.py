# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes that run, as the graph shows them."""

from rclpy.node import Node

from checkweigher_core.ros import ports


def running_lanes(node: Node) -> set[str]:
    """Return the namespaces, without slashes, in which verdicts are published.

    A lane that is only awaited does not run: its command `run` subscribes before it starts nodes.
    """
    kind, ending = ports.VERDICT.message_type, f'/{ports.VERDICT.name}'
    return {
        topic.removesuffix(ending).strip('/')
        for topic, kinds in node.get_topic_names_and_types()
        if topic.endswith(ending) and kind in kinds and node.count_publishers(topic)
    }

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are connected and served, as those of one process are."""

from collections.abc import Iterator
import itertools

import pytest
import rclpy
from rclpy.node import Node
from running import wait_for

from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner

# No two tests have nodes of the same name: DDS may show one of the test before for a while.
_NUMBERS = itertools.count(1)


class Process:
    """A process of nodes."""

    def __init__(self) -> None:
        self.spinner = Spinner()

    def node(self, kind: type[Node] = PortNode) -> Node:
        """Return one more node, not served yet."""
        return kind(f'node_{next(_NUMBERS)}')

    wait_for = staticmethod(wait_for)


@pytest.fixture
def process() -> Iterator[Process]:
    rclpy.init()
    process = Process()
    yield process
    process.spinner.stop()
    rclpy.try_shutdown()

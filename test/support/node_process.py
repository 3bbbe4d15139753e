# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are connected and served, as those of one process are."""

from collections.abc import Callable, Iterator
import itertools
import os
import time

import pytest
import rclpy
from rclpy.node import Node

from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner

PATIENCE = 60.0  # s
# No two tests have nodes of the same name: DDS may show one of the test before for a while.
_NUMBERS = itertools.count(1)


class Process:
    """A process of nodes."""

    def __init__(self) -> None:
        self.spinner = Spinner()

    def node(self, kind: type[Node] = PortNode) -> Node:
        """Return one more node, not served yet."""
        return kind(f'node_{next(_NUMBERS)}')

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.005)


@pytest.fixture
def process() -> Iterator[Process]:
    rclpy.init(domain_id=1 + os.getpid() % 101)
    process = Process()
    yield process
    process.spinner.stop()
    rclpy.try_shutdown()

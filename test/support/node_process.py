# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are connected and served, as those of one process are."""

from collections.abc import Iterator
from contextlib import contextmanager
import itertools

import pytest
import rclpy
from rclpy.node import Node
from running import wait_for

from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner

# No two tests have nodes of the same name: DDS may show one of the test before for a while.
_NUMBERS = itertools.count(1)


@contextmanager
def spinning() -> Iterator[Spinner]:
    """Run ROS and a spinner of nodes during a block."""
    rclpy.init()
    spinner = Spinner()
    try:
        yield spinner
    finally:
        spinner.stop()
        rclpy.try_shutdown()


class Process:
    """A process of nodes."""

    def __init__(self, spinner: Spinner) -> None:
        self.spinner = spinner

    def node(self, kind: type[Node] = PortNode) -> Node:
        """Return one more node, not served yet."""
        return kind(f'node_{next(_NUMBERS)}')

    wait_for = staticmethod(wait_for)


@pytest.fixture
def process() -> Iterator[Process]:
    with spinning() as spinner:
        yield Process(spinner)

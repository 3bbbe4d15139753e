# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a node and print when it waits for its first message, s of the monotonic clock."""

from importlib import import_module
import sys
import time

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node


class PrintingExecutor(SingleThreadedExecutor):
    """Print the time when a node is added."""

    def add_node(self, node: Node) -> bool:
        """Serve a node."""
        print(time.monotonic(), flush=True)
        return bool(super().add_node(node))


if __name__ == '__main__':
    spinner = import_module('checkweigher_core.ros.spinner')
    spinner.SingleThreadedExecutor = PrintingExecutor
    import_module(sys.argv[1]).main([sys.argv[0], *sys.argv[2:]])

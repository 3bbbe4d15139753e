# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A process that sends back what it hears: two hops over DDS and nothing else."""

import sys

from builtin_interfaces.msg import Time
from rclpy.node import Node

from checkweigher_core.ros.running import run


class Echo(Node):
    """Publish what comes on `there` on `back`."""

    def __init__(self) -> None:
        super().__init__('echoing')
        back = self.create_publisher(Time, 'back', 1000)
        self.create_subscription(Time, 'there', back.publish, 1000)


if __name__ == '__main__':
    run(Echo, sys.argv)

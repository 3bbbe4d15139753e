# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A process that sends back each message, for the time of two hops over DDS."""

import sys

from builtin_interfaces.msg import Time
from rclpy.node import Node

from checkweigher_core.ros.running import run


class Echo(Node):
    """Node that publishes each message of the topic `there` on the topic `back`."""

    def __init__(self) -> None:
        super().__init__('echoing')
        back = self.create_publisher(Time, 'back', 1000)
        self.create_subscription(Time, 'there', back.publish, 1000)


if __name__ == '__main__':
    run(Echo, sys.argv)

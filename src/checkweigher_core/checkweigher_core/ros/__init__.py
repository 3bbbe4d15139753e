# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ROS layer that the nodes share: ports, stage nodes, outputs, diagnostics."""

import os

from checkweigher_core.ros.graph.discovery import set_profiles

# Before rclpy makes a context. A node that reaches a line by DDS can stop it and change its limits:
# those of other computers reach it only where that is wanted.
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
set_profiles()

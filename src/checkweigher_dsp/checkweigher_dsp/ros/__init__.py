# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rim to ROS: ports, stage nodes, outputs, diagnostics. Only this room knows rclpy."""

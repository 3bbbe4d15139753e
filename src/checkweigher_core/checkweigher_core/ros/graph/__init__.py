# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a lane in the ROS graph: their place, connections and rights."""

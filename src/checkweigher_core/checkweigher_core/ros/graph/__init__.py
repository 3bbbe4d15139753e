# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who is who in the ROS graph: the place of each node of a lane, its hosts, and strangers."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who is who in the ROS graph: place, connections and rights of each node of a lane."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Code that all packages share: records, parameters, settings and state files, the ROS layer."""

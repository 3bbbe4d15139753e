# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Shared code of all packages: records, parameters, settings files, state files and ROS layer."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stages of an in-motion checkweigher, from samples to verdicts, and their ROS 2 nodes."""

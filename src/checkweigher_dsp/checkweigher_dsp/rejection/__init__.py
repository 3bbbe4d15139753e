# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejection: the verdict on each item and the time by which the rejector needs it."""

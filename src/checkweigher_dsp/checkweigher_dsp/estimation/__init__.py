# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimation: the mass of an item and its uncertainty from a denoised window."""

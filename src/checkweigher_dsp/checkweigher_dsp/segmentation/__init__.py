# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Segmentation: one weigh window for each item from samples and edges."""

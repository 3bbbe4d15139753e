# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Segmentation of the samples into one weigh window for each item."""

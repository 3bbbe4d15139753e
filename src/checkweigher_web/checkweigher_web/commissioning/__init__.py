# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning of a machine in five steps, each with its own panel on one page."""

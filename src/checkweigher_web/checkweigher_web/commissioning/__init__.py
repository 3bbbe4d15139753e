# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning of a machine as a path of steps, each with a panel of its own."""

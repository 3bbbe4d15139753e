# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipes, users and settings of a simulated machine, which a technician can change."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipes, users and simulated machine, which a technician changes on the page."""

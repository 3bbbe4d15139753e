# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimation of the mass of an item, and of its uncertainty, from the weigh window of the item."""

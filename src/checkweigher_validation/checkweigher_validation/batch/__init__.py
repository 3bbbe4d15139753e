# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches of items, with statistics, giveaway and signatures."""

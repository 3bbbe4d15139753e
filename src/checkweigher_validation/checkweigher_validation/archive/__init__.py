# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Weighing of many bags in parallel, with a file of results for each bag and a summary."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches: what passed, how it is judged, and the report."""

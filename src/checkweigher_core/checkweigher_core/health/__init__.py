# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings on the health of the nodes, for publication on `/diagnostics`."""

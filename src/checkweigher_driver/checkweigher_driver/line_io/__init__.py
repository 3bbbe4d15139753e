# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejector, stop and photo-eyes on the wires of the machine."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a line: bags, CSV logs and simulated lines."""

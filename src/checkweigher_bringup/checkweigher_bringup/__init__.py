# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command line of a checkweigher, and the program that runs all nodes of a line in one process."""

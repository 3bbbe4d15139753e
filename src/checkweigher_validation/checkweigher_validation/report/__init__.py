# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of an evaluation: one HTML file that needs nothing else."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The machine's side of a checkweigher: sources of samples and photo-eye edges, and their node."""

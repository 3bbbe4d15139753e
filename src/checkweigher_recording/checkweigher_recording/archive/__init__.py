# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search for bags, copies of bags from object stores, and digests of bags."""

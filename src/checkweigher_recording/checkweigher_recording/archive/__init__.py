# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many bags: finding them, copying those of an object store, and their digests."""

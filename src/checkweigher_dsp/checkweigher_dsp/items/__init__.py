# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items on the belt: their edges, their tracking, the queue of edges."""

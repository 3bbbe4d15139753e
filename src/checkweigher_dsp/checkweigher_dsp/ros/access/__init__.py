# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who may do what on a lane: the rights of its nodes, the key of a locked line, limits of calls."""

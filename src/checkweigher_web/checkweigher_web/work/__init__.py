# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work of a user on a lane: actions, performance tests, signatures, reports, audit log and bags."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many bags: the job of one, what is kept of it, and the summary of all."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many bags: the job of one bag, the file of its results, and the summary of all bags."""

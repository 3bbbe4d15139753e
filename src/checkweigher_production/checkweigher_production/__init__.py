# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Production: recipes, prepackages, filler feedback, statistics, records and the audit log."""

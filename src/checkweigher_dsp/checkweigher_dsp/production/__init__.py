# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Production: recipes, prepackages, statistics and the audit log."""

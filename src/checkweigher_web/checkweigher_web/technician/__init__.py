# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a technician changes on the page beside the commissioning: recipes, users, practice."""

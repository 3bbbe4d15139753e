# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Actions on a machine from the page, through the services of its nodes."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who may look at the page and who may act: users, sessions, login, and what guards them."""

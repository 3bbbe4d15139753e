# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Access to the page: users, sessions, login, and the check of all requests."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands that run a line or its page, or that work on a running line."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the rejector control. Each has its own state, and none has a thread or a port."""

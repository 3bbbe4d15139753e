# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the rejector control, each with its own state, without thread and port."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands that tune the estimators, evaluate their accuracy, and verify a machine."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Offline validation of a checkweigher: protocol, tuning and accuracy."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of estimators: passes of known mass, errors, classes and tables."""

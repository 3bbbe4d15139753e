# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of estimators on simulated machines, and the best accuracy on these machines."""

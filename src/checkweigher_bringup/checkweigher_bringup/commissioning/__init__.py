# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning: static calibration, dynamic setting, verification, performance test."""

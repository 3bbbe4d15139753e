# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commissioning: calibration with masses at rest, setting with passes of known mass."""

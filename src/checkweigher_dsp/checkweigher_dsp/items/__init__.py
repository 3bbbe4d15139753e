# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tracking of the items on the belt by the edges of the photo-eyes."""

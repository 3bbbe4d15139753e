# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bringing up a checkweigher: the one-process line and the command line."""

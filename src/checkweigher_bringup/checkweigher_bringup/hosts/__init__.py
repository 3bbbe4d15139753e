# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes on several hosts: the description of such a line, and what each host runs of it."""

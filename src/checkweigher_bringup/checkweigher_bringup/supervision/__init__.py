# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Processes of a line: they are started, watched and restarted, here or by systemd."""

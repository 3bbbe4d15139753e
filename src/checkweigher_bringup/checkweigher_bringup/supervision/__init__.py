# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Supervision of the processes of a line, by this program or by systemd."""

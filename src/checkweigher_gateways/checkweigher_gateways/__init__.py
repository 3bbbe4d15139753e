# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gateways from the topics of the lanes into the plant."""

KINDS = ('metrics', 'mqtt')

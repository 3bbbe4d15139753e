# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gateways that carry the topics of the lanes to the systems of the plant."""

KINDS = ('metrics', 'mqtt', 'opcua')

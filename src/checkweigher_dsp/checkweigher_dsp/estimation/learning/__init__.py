# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learning of weights from products of unknown mass while the line runs."""

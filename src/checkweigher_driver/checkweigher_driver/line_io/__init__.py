# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Digital inputs and outputs of the machine, such as photo-eyes, rejector and stop."""

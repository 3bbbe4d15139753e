# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The protocol of the paper on a simulated machine, and the bound of any estimate."""

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Driver of a checkweigher: sources of samples and edges, and outputs and inputs of the machine."""

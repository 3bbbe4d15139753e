# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rights of the nodes of a lane: the policy for SROS2, and the enclave of a process."""

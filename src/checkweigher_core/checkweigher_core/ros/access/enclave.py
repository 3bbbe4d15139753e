# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How a process takes its enclave of the security policy."""

import os


def enclave_arguments(lane: str, name: str) -> list[str]:
    """Return the ROS arguments for the enclave of a name in a lane, none without security."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return []
    return ['--enclave', f'/{lane}/{name}' if lane else f'/{name}']

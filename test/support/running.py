# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Running the command line as a user does, in a ROS domain of the tests' own."""

import os
from pathlib import Path
import subprocess
import sys

ROOT = Path(__file__).parents[2]
BAGS = ROOT / 'bags'
PATIENCE = 60.0  # s, for an event that comes at once unless the machine is busy

# A run of the tests talks to itself alone. Domains up to 101 leave all ports below those that
# Linux hands out to others.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 101)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


def run_command(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own, as a user does."""
    return subprocess.run(
        [sys.executable, '-m', 'checkweigher_bringup.cli', *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )

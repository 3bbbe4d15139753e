# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Running the command line as a user does, in a ROS domain of the tests' own."""

import os
from pathlib import Path
import socket
import subprocess
import sys

ROOT = Path(__file__).parents[2]
BAGS = ROOT / 'bags'
PATIENCE = 60.0  # s, for an event that comes at once unless the machine is busy


def _free_domain() -> tuple[int, socket.socket]:
    """Find a ROS domain that no other run of tests has; it is taken while the socket is open."""
    # Domains up to 101 leave all ports below those that Linux hands out to others.
    for number in range(101):
        domain = 1 + (os.getpid() + number) % 101
        taken = socket.socket(socket.AF_UNIX)
        try:
            taken.bind(f'\0checkweigher-tests-in-domain-{domain}')
        except OSError:
            taken.close()
            continue
        return domain, taken
    raise RuntimeError('101 runs of the tests at once: no ROS domain is left')


# Each process of tests talks to itself alone.
_domain, _taken = _free_domain()
os.environ['ROS_DOMAIN_ID'] = str(_domain)
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

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Running the command line as a user does, in a ROS domain of the tests' own."""

from collections.abc import Callable
import os
from pathlib import Path
import socket
import subprocess
import sys
import time

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


def words_of(*arguments: object) -> list[str]:
    """Return the words of the command line, for a process of its own, as a user starts it."""
    return [sys.executable, '-m', 'checkweigher_bringup.cli', *map(str, arguments)]


def run_command(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    """Run the command line until it ends."""
    words = words_of(*arguments)
    return subprocess.run(words, capture_output=True, text=True, timeout=timeout, check=False)


def wait_for(
    condition: Callable[[], object], what: str = 'a condition', timeout: float = PATIENCE
) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f'waited in vain for {what}'
        time.sleep(0.005)


def children(pid: int) -> list[int]:
    """Return the processes that a process has started and that have not ended."""
    threads = Path(f'/proc/{pid}/task').iterdir()
    return [int(child) for path in threads for child in (path / 'children').read_text().split()]


def free_port() -> int:
    """Return a TCP port of this computer that nobody uses."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])

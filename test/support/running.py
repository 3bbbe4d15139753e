# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Running the command line as a user does, in a ROS domain of the tests' own."""

from collections.abc import Callable
import csv
import hashlib
import os
from pathlib import Path
import re
import socket
import subprocess
import sys
import time
from typing import Any, TypeVar

ROOT = Path(__file__).parents[2]
BAGS = ROOT / 'bags'
PATIENCE = 60.0  # s, for an event that comes at once unless the machine is busy

T = TypeVar('T')
# What the fixtures `checkweigher` and `rows` return.
Run = Callable[..., subprocess.CompletedProcess[str]]
Rows = Callable[..., list[dict[str, str]]]


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


_PIPES = {'text': True, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE}


def command_line(*arguments: object) -> list[str]:
    """Return the words that run the command line in a process of its own, as a user does."""
    return [sys.executable, '-m', 'checkweigher_bringup.cli', *map(str, arguments)]


def start_command(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Start a command; its output goes to pipes, if the `options` of Popen say nothing else."""
    return subprocess.Popen(command_line(*arguments), **{**_PIPES, **options})


def run_command(
    *arguments: object, timeout: float = 120, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, with `options` as in `start_command`."""
    words = command_line(*arguments)
    return subprocess.run(words, timeout=timeout, check=False, **{**_PIPES, **options})


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file that a command has written."""
    with path.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def printed(page: str, folder: Path) -> str:
    """Write the program that a page of the docs prints, and return its path."""
    code = re.search(r'```python\n(.*?)```', (ROOT / f'docs/{page}.md').read_text(), re.DOTALL)
    assert code
    path = folder / f'{page}.py'
    path.write_text(code[1])
    return str(path)


def digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each Parquet file that `weigh --output` has written."""
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob('*.parquet'))
    }


def wait_for(condition: Callable[[], T], what: str = 'a condition', timeout: float = PATIENCE) -> T:
    """Wait until a condition holds, and return what it gave."""
    end = time.monotonic() + timeout
    while not (found := condition()):
        assert time.monotonic() < end, f'waited in vain for {what}'
        time.sleep(0.005)
    return found


def children(pid: int) -> list[int]:
    """Return the processes that a process has started and that have not ended."""
    threads = Path(f'/proc/{pid}/task').iterdir()
    return [int(child) for path in threads for child in (path / 'children').read_text().split()]


def family(mark: str) -> dict[int, str]:
    """Return number and command line of each process whose environment has a mark."""
    found = {}
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            if mark.encode() in (folder / 'environ').read_bytes():
                words = (folder / 'cmdline').read_bytes().split(b'\0')
                if words != [b'']:  # one that has ended
                    found[int(folder.name)] = b' '.join(words).decode(errors='replace')
        except OSError:
            continue
    return found


def free_port() -> int:
    """Return a TCP port of this computer that nobody uses."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])

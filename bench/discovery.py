# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Time and traffic of discovery: lanes of one process each, over four network namespaces.

python3 bench/discovery.py 10 50 100 --modes hosts subnet server

The drivers do not run: what is measured is that the nodes find each other. Bytes are those that
pass the switch between the hosts, to the ports that RTPS has for discovery (with a server: all).
Needs root, the command ip and /dev/net/tun.
"""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
import select
import subprocess
import sys
from tempfile import TemporaryDirectory
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test/support'))

from network import Network, NoNetworkError, network

from checkweigher_bringup.spinning import node_command, write_parameter_file

HOSTS = 4
SERVER = 'server'  # on host0
STEADY = 15.0  # s
# A node that says after what time it has found the verdicts of so many lanes, and stays.
LOOKER = """
import sys, time
import checkweigher_core.ros
import rclpy
began = time.monotonic()
rclpy.init()
node = rclpy.create_node(f'looker_{sys.argv[2]}')
while sum(n.endswith('/verdict') for n, _ in node.get_topic_names_and_types()) < int(sys.argv[1]):
    time.sleep(0.05)
print(time.monotonic() - began, flush=True)
sys.stdin.read()
"""
Process = subprocess.Popen[str]


def start(words: list[str]) -> Process:
    """Start a process whose output is read."""
    pipe = subprocess.PIPE
    return subprocess.Popen(
        words, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True, process_group=0
    )


@contextmanager
def ended_after() -> Iterator[list[Process]]:
    """Have a list of processes that are ended after the block."""
    started: list[Process] = []
    try:
        yield started
    finally:
        for process in started:
            process.terminate()
        for process in started:
            with suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=20)
            process.kill()


def discovery_bytes(hosts: Network, mode: str) -> int:
    """Return how many bytes of discovery have passed the switch."""
    counts = hosts.order()
    other = counts.get('bytes of other', 0) if mode == SERVER else 0
    return counts.get('bytes of discovery', 0) + other


def resident(processes: list[Process]) -> float:
    """Return the memory of processes, MB."""
    pages = [int(Path(f'/proc/{p.pid}/statm').read_text().split()[1]) for p in processes]
    return 4096 * sum(pages) / 1e6


def measure(mode: str, lanes: int, patience: float, file: Path) -> str:
    """Return a row of the table."""
    kind = 'host0' if mode == SERVER else mode
    with (
        network(HOSTS) as hosts,
        hosts.discovery(kind) as variables,
        ended_after() as started,
    ):
        looker = [sys.executable, '-c', LOOKER, str(lanes)]
        watching = {**variables, 'ROS_SUPER_CLIENT': 'true'}
        first = start([*hosts.command(0, **watching), *looker, 'first'])
        started.append(first)
        began = time.monotonic()
        running = []
        for number in range(lanes):
            command = node_command('checkweigher_bringup.line', f'lane{number}', file)
            running.append(start([*hosts.command(number % HOSTS, **variables), *command]))
            started.append(running[-1])
        limit = began + patience
        while not _readable(first) and time.monotonic() < limit:
            time.sleep(0.1)
        if not _readable(first):
            return f'| {mode} | {lanes} | not within {patience:.0f} s | | | | |'
        found = time.monotonic() - began
        at_start = discovery_bytes(hosts, mode)
        time.sleep(STEADY)
        before = discovery_bytes(hosts, mode)
        time.sleep(STEADY)
        steady = (discovery_bytes(hosts, mode) - before) / STEADY
        second = start([*hosts.command(1, **watching), *looker, 'second'])
        started.append(second)
        assert second.stdout is not None
        joined = float(second.stdout.readline())
        memory = resident(running) / lanes
    return (
        f'| {mode} | {lanes} | {found:.0f} | {joined:.1f} | {at_start / 1e6:.1f} | '
        f'{steady / 1e3:.0f} | {memory:.0f} |'
    )


def _readable(process: Process) -> bool:
    return bool(select.select([process.stdout], [], [], 0)[0])


def main() -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('lanes', nargs='+', type=int)
    parser.add_argument('--modes', nargs='+', default=['hosts'])
    parser.add_argument('--patience', type=float, default=400.0, help='s for the lanes of a row')
    arguments = parser.parse_args()
    print(
        '| discovery | lanes | all found after, s | a node that joins, s | MB until then | '
        'kB/s afterwards | MB of memory a lane |\n' + '|---' * 7 + '|',
        flush=True,
    )
    with TemporaryDirectory() as folder:
        file = Path(folder) / 'idle.yaml'
        write_parameter_file(file, {'driver': {'autostart': False}})
        for mode in arguments.modes:
            for lanes in arguments.lanes:
                print(measure(mode, lanes, arguments.patience, file), flush=True)


if __name__ == '__main__':
    try:
        main()
    except NoNetworkError as error:
        raise SystemExit(str(error)) from None

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A lane whose samples or edges are stamped on two hosts, by nodes of somebody's own."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
import json
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

from graph import wait_for
from hosts import Hosts, two_hosts
from processes import parameter_file
from running import PATIENCE, ROOT

from checkweigher_bringup.hosts.description import Share
from checkweigher_bringup.hosts.running import share_command
from checkweigher_bringup.spinning import running_processes, start_process
from checkweigher_dsp.records import Decision
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.ports import STAGES

# One half of a driver: the records of some kinds of a simulated line, at their time.
HALF = """
import sys, time
import checkweigher_dsp.ros
import rclpy
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import to_message
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate
name, begin = sys.argv[1], float(sys.argv[2])
line = simulate(SimulationParameters(count=300, spacing=1.0, lead_in=1.0))
mine = {'cell': ports.LOAD_CELL_SAMPLES, 'eyes': ports.PHOTO_EYES}[name]
rclpy.init()
node = rclpy.create_node(name, namespace='belt')
if name == 'cell':
    info = node.create_publisher(
        ports.LOAD_CELL_INFO.type, ports.LOAD_CELL_INFO.name, ports.LOAD_CELL_INFO.qos)
    info.publish(to_message(ports.LOAD_CELL_INFO, line.load_cell, stamp=0))
publisher = node.create_publisher(mine.type, mine.name, mine.qos)
start = None
for record in line:
    start = start or record.stamp
    if type(record) is mine.record:
        time.sleep(max(0.0, begin + (record.stamp - start) / 1e9 - time.time()))
        publisher.publish(to_message(mine, record))
"""
# The supervisor of a host whose clock is 1 ms ahead.
AHEAD = """
import time
true = time.time_ns
time.time_ns = lambda: true() + 1_000_000
from checkweigher_bringup.hosts.supervisor import main
main()
"""
LINE = """
hosts: {a: 10.75.0.1, b: 10.75.0.2}
discovery: subnet
lanes: {belt: {host: a}}
"""
REJECT: dict[str, object] = {'rejector_distance': 1.5, 'verdict_margin': 0.5}


class Told:
    """The verdicts of the lane, as a witness on host a writes them to a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seen = 0

    def wait_for(self, decision: Decision) -> dict[str, Any]:
        """Wait for the next verdict of this kind."""
        end = time.monotonic() + 2 * PATIENCE
        while True:
            whole = self._path.read_text().rpartition('\n')[0].splitlines()
            new, self._seen = whole[self._seen :], len(whole)
            for told in map(json.loads, new):
                if told['topic'] == ports.VERDICT.name and told['decision'] == decision:
                    return told
            assert time.monotonic() < end, whole[-5:]
            time.sleep(0.1)


@contextmanager
def witness(words: list[str], path: Path) -> Iterator[Told]:
    script = str(ROOT / 'test/support/witness.py')
    with path.open('wb') as file:
        process = subprocess.Popen(
            [*words, sys.executable, script, 'belt'], stdin=subprocess.PIPE, stdout=file
        )
    try:
        wait_for(lambda: 'ready' in path.read_text())
        yield Told(path)
    finally:
        process.communicate(timeout=PATIENCE)


def said(hosts: Hosts) -> str:
    """Return what `status` shows of the lane."""
    words = [sys.executable, '-m', 'checkweigher_bringup.cli', 'status', '--namespace', 'belt']
    done = subprocess.run(
        [*hosts['a'], 'env', 'COLUMNS=400', *words, '--count', '1'],
        capture_output=True, text=True, timeout=PATIENCE,
    )  # fmt: skip
    return done.stdout


def test_items_are_weighed_only_while_the_clocks_of_both_hosts_are_known_to_agree(tmp_path: Path):
    (tmp_path / 'line.yaml').write_text(LINE)
    file = parameter_file(tmp_path / 'stages.yaml', {'reject': REJECT})
    begin = time.time() + 15.0
    python = [sys.executable, '-c']
    supervisor = [sys.executable, '-m', 'checkweigher_bringup.hosts.supervisor']
    with two_hosts() as hosts, ExitStack() as stack:
        told = stack.enter_context(witness(hosts['a'], tmp_path / 'told'))
        commands = {
            'stages': [*hosts['a'], *share_command(Share('belt', STAGES, (file,), {}))],
            'cell': [*hosts['a'], *python, HALF, 'cell', str(begin)],
            'eyes': [*hosts['b'], *python, HALF, 'eyes', str(begin)],
        }
        stack.enter_context(running_processes(commands))
        while told.wait_for(Decision.FAULT)['reasons'] != ['EdgeMismatch']:
            pass  # the nodes were starting
        assert 'come from two hosts, of which one has no supervisor' in said(hosts)

        described = [str(tmp_path / 'line.yaml')]
        one = {'a': [*hosts['a'], *supervisor, *described, 'a']}
        stack.enter_context(running_processes(one))
        with running_processes({'b': [*hosts['b'], *supervisor, *described, 'b']}):
            assert told.wait_for(Decision.ACCEPT)['mass'] > 0

        start = start_process([*hosts['b'], *python, AHEAD, *described, 'b'])
        stack.callback(start.wait)
        stack.callback(start.terminate)
        wait_for(lambda: 'come from a and b, whose clocks are not known to agree' in said(hosts))
        assert 'EdgeMismatch' in told.wait_for(Decision.FAULT)['reasons']


def test_edges_of_another_host_beside_those_of_the_driver_are_a_strangers(tmp_path: Path):
    driver = {'simulator.count': 0, 'simulator.spacing': 1.0, 'lossless': False}
    file = parameter_file(tmp_path / 'line.yaml', {'driver': driver, 'reject': REJECT})
    with two_hosts() as hosts, witness(hosts['a'], tmp_path / 'told') as told:
        commands = {
            name: [*hosts['a'], *share_command(Share('belt', nodes, (file,), {}))]
            for name, nodes in (('stages', STAGES), ('driver', ('driver',)))
        }
        half = [sys.executable, '-c', HALF, 'eyes', str(time.time())]
        with running_processes(commands):
            assert told.wait_for(Decision.ACCEPT)['mass'] > 0
            with running_processes({'eyes': [*hosts['b'], *half]}):
                while 'ForeignPublisher' not in told.wait_for(Decision.FAULT)['reasons']:
                    pass  # on a busy machine a mass comes late

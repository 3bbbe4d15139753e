# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""`run --line --host`: two hosts, one lane on each and one lane over both."""

from functools import partial
from pathlib import Path
import queue
import sys
from typing import Any

from graph import wait_for
from running import ROOT

from checkweigher_bringup.hosts.description import read_line
from checkweigher_bringup.hosts.supervisor import Supervisor, comparing_clocks
from checkweigher_bringup.spinning import node_command, running_processes, spinning
from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.health.status_board import StatusBoard
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.port_node import PortNode

RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'
LINE = f"""
hosts: {{hall: 127.0.0.1, server: 127.0.0.2}}
lanes:
  whole:
    host: hall
    recipes: {RECIPES}
    product: crisps_150g
  split:
    nodes:
      hall: [driver, reject]
      server: [product, segmenter, denoise, identifier]
"""
EXPECTED = {f'{lane}/{node}' for lane in ('whole', 'split') for node in ports.NODES}


def test_each_host_runs_its_share(tmp_path: Path):
    file = tmp_path / 'line.yaml'
    file.write_text(LINE)
    run = [sys.executable, '-m', 'checkweigher_bringup.cli', 'run', '--line', str(file)]
    commands = {host: [*run, '--host', host] for host in ('hall', 'server')}
    board, passed = StatusBoard(), {'whole': 0, 'split': 0}
    clocks: dict[str, int] = {}
    with running_processes(commands) as processes, spinning() as spinner:
        node = PortNode('looker')
        node.subscribe(ports.DIAGNOSTICS, lambda m: board.add(0.0, m.status))
        node.subscribe(ports.DIAGNOSTICS, partial(hear_clocks, clocks))
        for lane in passed:
            topic = f'/{lane}/{ports.VERDICT.name}'
            node.create_subscription(ports.VERDICT.type, topic, partial(count, passed, lane), 10)
        spinner.add(node)
        wait_for(lambda: all(passed.values()))
        wait_for(lambda: {row.node for row in board.rows(0.0)} >= EXPECTED)
        wait_for(lambda: "product 'crisps_150g'" in recipe(board))
        # Two addresses of one computer: its clock agrees with itself.
        expected = {'supervisor_hall: Clock of server', 'supervisor_server: Clock of hall'}
        wait_for(lambda: {name for name, level in clocks.items() if level == Level.OK} == expected)
        assert all(process.poll() is None for process in processes.values())


def count(passed: dict[str, int], lane: str, verdict: object) -> None:
    passed[lane] += 1


def hear_clocks(clocks: dict[str, int], message: Any) -> None:
    for status in message.status:
        if ': Clock of ' in status.name:
            clocks[status.name] = status.level[0]


def recipe(board: StatusBoard) -> str:
    rows = board.rows(0.0)
    return next((r.message for r in rows if (r.node, r.aspect) == ('whole/product', 'Recipe')), '')


def test_a_supervisor_that_tells_of_clocks_hears_the_nodes_of_its_host(tmp_path: Path):
    """It starts what it does not hear again."""
    (tmp_path / 'line.yaml').write_text(LINE)
    line, alive = read_line(tmp_path / 'line.yaml'), queue.SimpleQueue[str]()
    segmenter = {'segmenter': node_command(ports.NODES['segmenter'], 'split')}
    with running_processes(segmenter), spinning() as spinner:
        node = Supervisor('hall')
        node.hear_nodes(alive.put)
        with comparing_clocks(line, 'hall', node):
            spinner.add(node)
            wait_for(lambda: not alive.empty() and alive.get() == 'split/segmenter')

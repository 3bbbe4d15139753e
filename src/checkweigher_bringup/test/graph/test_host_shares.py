# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""`run --line --host`: two hosts, one lane on each and one lane over both."""

from functools import partial
from pathlib import Path
import socket

from graph import wait_for
from running import ROOT, command_line

from checkweigher_bringup.spinning import running_processes, spinning
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.status_board import StatusBoard

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
      hall: [driver, segmenter, reject]
      server: [product, denoise, identifier]
"""
EXPECTED = {f'{lane}/{node}' for lane in ('whole', 'split') for node in ports.NODES}


def test_each_host_runs_its_share(tmp_path: Path):
    file = tmp_path / 'line.yaml'
    file.write_text(LINE)
    commands = {
        host: command_line('run', '--line', file, '--host', host) for host in ('hall', 'server')
    }
    board, passed = StatusBoard(), {'whole': 0, 'split': 0}
    with running_processes(commands) as processes, spinning() as spinner:
        node = PortNode('looker')
        node.subscribe(ports.DIAGNOSTICS, lambda m: board.add(0.0, m.status))
        for lane in passed:
            topic = f'/{lane}/{ports.VERDICT.name}'
            node.create_subscription(ports.VERDICT.type, topic, partial(count, passed, lane), 10)
        spinner.add(node)
        wait_for(lambda: all(passed.values()))
        wait_for(lambda: {row.node for row in board.rows(0.0)} >= EXPECTED)
        wait_for(lambda: "product 'crisps_150g'" in recipe(board))
        assert board.hosts() == {lane: {socket.gethostname()} for lane in passed}
        told = {row.node for row in board.rows(0.0) if row.aspect == 'Host clock'}
        assert told == {f'{lane}/{node}' for lane in passed for node in ('driver', 'product')}
        assert all(process.poll() is None for process in processes.values())


def count(passed: dict[str, int], lane: str, verdict: object) -> None:
    passed[lane] += 1


def recipe(board: StatusBoard) -> str:
    rows = board.rows(0.0)
    return next((r.message for r in rows if (r.node, r.aspect) == ('whole/product', 'Recipe')), '')

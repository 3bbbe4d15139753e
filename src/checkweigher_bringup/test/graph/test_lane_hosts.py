# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes on several hosts: shares, a good network, and a network with loss, delay and partition."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
import json
from pathlib import Path
import socket
import subprocess
import sys
import threading
import time
from typing import Any

from network import Network, NoNetworkError, network
from processes import LINE, parameter_file
import pytest
from running import BAGS, PATIENCE, ROOT, command_line, wait_for
from verdicts import offline_verdicts

from checkweigher_bringup.hosts.description import AT_MACHINE
from checkweigher_bringup.spinning import node_command, running_processes, spinning
from checkweigher_core.records import Decision, Eye
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.status_board import StatusBoard
from checkweigher_recording.bags.reading import read_bag

AWAY = ('denoise', 'identifier')
Told = dict[str, Any]
Values = dict[str, dict[str, object]]


class Witness:
    """Listener on a host for the verdicts of the lanes of this host."""

    def __init__(self, words: list[str], lanes: list[str]) -> None:
        script = str(ROOT / 'test/support/witness.py')
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [*words, sys.executable, script, *lanes], stdin=pipe, stdout=pipe
        )
        self.told: dict[str, list[Told]] = {lane: [] for lane in lanes}
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        assert self._ready.wait(timeout=PATIENCE)

    def _read(self) -> None:
        for line in self._process.stdout or ():
            told = json.loads(line)
            if told['topic'] == 'ready':
                self._ready.set()
            else:
                self.told[told['lane']].append(told)

    def end(self) -> None:
        self._process.communicate(timeout=PATIENCE)
        self._thread.join(timeout=PATIENCE)


@contextmanager
def lanes_over(
    hosts: Network, count: int, files: Mapping[str, Path], environment: Mapping[str, str]
) -> Iterator[dict[str, Witness]]:
    """Run lanes, each with its machine on one of `count` hosts and its weighing on the next one."""
    commands = {}
    for number, (lane, file) in enumerate(files.items()):
        for host, nodes in ((number, AT_MACHINE), (number + 1, AWAY)):
            command = node_command(LINE, lane, file, nodes=nodes)
            commands[f'{lane} {nodes}'] = [*hosts.command(host % count, **environment), *command]
    witnesses = [
        Witness(hosts.command(host, **environment), [*files][host::count]) for host in range(count)
    ]
    try:
        with running_processes(commands) as processes:
            yield {lane: witnesses[number % count] for number, lane in enumerate(files)}
            ended = [name for name, each in processes.items() if each.poll() is not None]
            assert not ended
    finally:
        for witness in witnesses:
            witness.end()


def verdicts(told: list[Told], since: int = 0) -> list[Told]:
    """Return the verdicts since a time, in order of entry."""
    found = [t for t in told if t['topic'] == ports.VERDICT.name and t['came'] >= since]
    return sorted(found, key=lambda verdict: verdict['item_id'])


def test_lanes_across_two_hosts_give_the_same_verdicts_as_offline(tmp_path: Path):
    lanes = {'lane1': 'paper_60', 'lane2': 'paper_90'}
    files = {}
    for lane, bag in lanes.items():
        driver = {'source': 'bag', 'bag.path': str(BAGS / bag), 'rate': 0.0}
        values: Values = {'driver': driver, 'reject': {'deadlines': False}}
        files[lane] = parameter_file(tmp_path / f'{lane}.yaml', values)
    try:
        with network(2) as hosts, lanes_over(hosts, 2, files, {}) as witnesses:
            told = {lane: witness.told[lane] for lane, witness in witnesses.items()}
            wait_for(lambda: all(len(verdicts(each)) >= 25 for each in told.values()),
                     'the verdicts', 2 * PATIENCE)  # fmt: skip
            counts = hosts.order()
    except NoNetworkError as error:
        pytest.skip(str(error))
    assert counts['bytes of other'] > 2 * 8 * 960 * 20  # the windows, 8 bytes a sample
    for lane, bag in lanes.items():
        given = verdicts(told[lane])
        bare = [{k: v for k, v in t.items() if k not in ('lane', 'topic', 'came')} for t in given]
        assert bare == offline_verdicts(read_bag(BAGS / bag))


HOSTS = 4
# Of 1.5 s between outfeed eye and rejector, half a second is for a busy machine.
VALUES: Values = {
    'driver': {
        'simulator.count': 0, 'simulator.masses': [0.1, 0.15, 0.2], 'simulator.lead_in': 5.0,
        'simulator.spacing': 2.0, 'lossless': False,
    },
    'reject': {'rejector_distance': 1.5, 'verdict_margin': 0.5},
}  # fmt: skip
OUTAGE = 8.0  # s
WEIGHED = 3  # items of each lane, before and after


def accepted(told: list[Told], since: int = 0) -> int:
    return sum(verdict['decision'] == Decision.ACCEPT for verdict in verdicts(told, since))


def wait_for_accepted(witnesses: dict[str, Witness], since: int, patience: float) -> None:
    """Wait until each lane has accepted some items since a time."""
    end = time.monotonic() + patience
    while True:
        counts = {lane: accepted(list(w.told[lane]), since) for lane, w in witnesses.items()}
        if min(counts.values()) >= WEIGHED:
            return
        assert time.monotonic() < end, counts
        time.sleep(0.2)


def check(lane: str, told: list[Told], begin: int, end: int) -> Counter[str]:
    """Check the verdicts of a lane, and count them by kind."""
    given = verdicts(told)
    while given[0]['decision'] != Decision.ACCEPT:  # its nodes were starting
        del given[0]
    first, last = given[0]['t1'], given[-1]['t1']
    entries = [
        t['stamp']
        for t in told
        if t['topic'] == ports.PHOTO_EYES.name and t['eye'] == Eye.INFEED and t['blocked']
        and first <= t['stamp'] <= last
    ]  # fmt: skip
    assert [verdict['t1'] for verdict in given] == sorted(entries), lane
    assert len({verdict['item_id'] for verdict in given}) == len(given), lane
    for verdict in given:
        weighed = verdict['estimate_id'] != 0
        # What came of no data is a fault, and what is accepted has its mass.
        assert weighed or verdict['decision'] == Decision.FAULT, (lane, verdict)
        assert verdict['decision'] != Decision.ACCEPT or verdict['mass'] > 0, (lane, verdict)
        assert not verdict['late'], (lane, verdict)  # the rejector's own host has them in time
    # In the middle of the outage nothing can have come.
    margin = (end - begin) // 3
    out = [v for v in given if begin + margin < v['came'] < end - margin]
    assert out, lane
    assert all(verdict['decision'] == Decision.FAULT for verdict in out), lane
    counts = Counter(Decision(verdict['decision']).name for verdict in given)
    counts['in the outage'] = len(out)
    return counts + Counter(f'FAULT {reason}' for v in given for reason in v['reasons'])


def try_network(count: int, folder: Path, patience: float, discovery: str) -> None:
    """Run lanes over a bad network and a partition, and count their verdicts."""
    file = parameter_file(folder / 'lane.yaml', VALUES)
    files = {f'lane{number}': file for number in range(count)}
    try:
        with (
            network(HOSTS) as hosts,
            hosts.discovery(discovery) as environment,
            lanes_over(hosts, HOSTS, files, environment) as witnesses,
        ):
            hosts.order(loss=0.02, delay=0.005, jitter=0.01)
            wait_for_accepted(witnesses, 0, patience)
            begin = time.monotonic_ns()
            hosts.order(apart=[0, 2])  # each lane is over two neighbours
            time.sleep(OUTAGE)
            counts = hosts.order(apart=[])
            end = time.monotonic_ns()
            wait_for_accepted(witnesses, end, patience)
            back = (time.monotonic_ns() - end) / 1e9
            told = {lane: list(witness.told[lane]) for lane, witness in witnesses.items()}
    except NoNetworkError as error:
        pytest.skip(str(error))
    assert counts['lost']
    assert counts['passed another']
    assert counts['kept apart']
    total = Counter[str]()
    for lane, each in told.items():
        total += check(lane, each, begin, end)
    print(f'\n{count} lanes: {dict(total)}; weighed again within {back:.0f} s; frames {counts}')


def test_every_item_of_two_lanes_has_one_verdict_on_a_bad_network(tmp_path: Path):
    try_network(2, tmp_path, 2 * PATIENCE, 'subnet')


@pytest.mark.soak
def test_every_item_of_twenty_lanes_has_one_verdict_on_a_bad_network(tmp_path: Path):
    # 40 processes that search for each other are more than two cores can serve.
    try_network(20, tmp_path, 10 * PATIENCE, 'host0')


RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'
HALL_AND_SERVER = f"""
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
    file.write_text(HALL_AND_SERVER)
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

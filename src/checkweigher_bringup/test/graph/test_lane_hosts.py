# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two lanes on two hosts with a cable between them, and what happens when it is pulled."""

from collections.abc import Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import subprocess
import sys
import threading
import time
from typing import Any

from hosts import Hosts, two_hosts
from processes import parameter_file
import pytest
from running import BAGS, PATIENCE, ROOT
from verdicts import offline_verdicts

from checkweigher_bringup.spinning import node_command, running_processes
from checkweigher_dsp.records import NANOSECONDS, Decision, Eye
from checkweigher_dsp.ros import ports
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate

LANES = {'lane1': 'paper_60', 'lane2': 'paper_90'}
# Lane 1 has the machine on one host and the computing on the other; in lane 2 all hops are hops
# over the cable.
HOSTS = {
    'lane1': {'driver': 'a', 'segmenter': 'b', 'denoise': 'b', 'identifier': 'b', 'reject': 'a'},
    'lane2': {'driver': 'b', 'segmenter': 'a', 'denoise': 'b', 'identifier': 'b', 'reject': 'a'},
}


Told = dict[str, Any]


class Witness:
    """What the verdicts and the edges were that came on a host, by lane."""

    def __init__(self, hosts: Hosts, host: str) -> None:
        words = [*hosts[host], sys.executable, str(ROOT / 'test/support/witness.py'), *LANES]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.verdicts: dict[str, list[Told]] = {lane: [] for lane in LANES}
        self.edges: dict[str, list[Told]] = {lane: [] for lane in LANES}
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        assert self._ready.wait(timeout=PATIENCE)

    def _read(self) -> None:
        found = {ports.VERDICT.name: self.verdicts, ports.PHOTO_EYES.name: self.edges}
        for line in self._process.stdout or ():
            told = json.loads(line)
            if told['topic'] == 'ready':
                self._ready.set()
            else:
                found[told['topic']][told['lane']].append(told)

    def wait_for(self, count: int, lane: str) -> None:
        """Wait for so many verdicts of a lane."""
        heard, end = 0, 0.0
        while len(self.verdicts[lane]) < count:
            if heard < len(self.verdicts[lane]) or not end:
                heard, end = len(self.verdicts[lane]), time.monotonic() + PATIENCE
            assert time.monotonic() < end, f'{lane} is silent after {heard} verdicts'
            time.sleep(0.05)

    def end(self) -> None:
        self._process.communicate(timeout=PATIENCE)
        self._thread.join(timeout=PATIENCE)


@contextmanager
def lines(
    hosts: Hosts, folder: Path, values: dict[str, dict[str, dict[str, object]]]
) -> Iterator[Witness]:
    """Run both lanes on both hosts, with a witness on host a."""
    commands = {}
    for lane, nodes in HOSTS.items():
        file = parameter_file(folder / f'{lane}.yaml', values[lane])
        for node, host in nodes.items():
            commands[f'{lane}/{node}'] = [
                *hosts[host],
                *node_command(ports.NODES[node], lane, file),
            ]
    witness = Witness(hosts, 'a')
    try:
        with running_processes(commands) as processes:
            yield witness
            ended = [name for name, process in processes.items() if process.poll() is not None]
            assert not ended
    finally:
        witness.end()


def bare(told: list[Told]) -> list[Told]:
    """Return verdicts without where and when they came, in order of entry."""
    verdicts = [{k: v for k, v in t.items() if k not in ('lane', 'topic', 'came')} for t in told]
    return sorted(verdicts, key=lambda verdict: verdict['item_id'])


def test_two_lanes_across_two_hosts_give_the_same_verdicts_as_offline(tmp_path: Path):
    values = {
        lane: {
            'driver': {'source': 'bag', 'bag.path': str(BAGS / bag), 'rate': 0.0},
            'reject': {'deadlines': False},
        }
        for lane, bag in LANES.items()
    }
    with two_hosts() as hosts, lines(hosts, tmp_path, values) as witness:
        for lane in LANES:
            witness.wait_for(25, lane)
        for host in 'ab':
            # Each passes at least the samples of one lane on: 4 bytes each.
            assert hosts.received(host) > 4 * 960 * 20
    for lane, bag in LANES.items():
        assert bare(witness.verdicts[lane]) == offline_verdicts(read_bag(BAGS / bag))


OUTAGE = 3.0  # s
SOURCE: dict[str, object] = {'masses': [0.1, 0.15, 0.2], 'lead_in': 8.0}
# The rejector is told 1.5 s after t3; half a second of it is for a busy machine.
REJECT: dict[str, object] = {'rejector_distance': 1.5, 'verdict_margin': 0.5}


@pytest.mark.soak
def test_a_pulled_cable_costs_the_items_of_that_time_and_no_more(tmp_path: Path):
    source = {f'simulator.{name}': value for name, value in SOURCE.items()}
    driver = {'simulator.count': 0, 'lossless': False, **source}
    values = {lane: {'driver': driver, 'reject': REJECT} for lane in LANES}
    with two_hosts() as hosts, lines(hosts, tmp_path, values) as witness:
        for lane in LANES:
            wait_for_accepted(witness, lane, 5)
        begin = time.monotonic_ns()
        hosts.plug(unplug=True)
        time.sleep(OUTAGE)
        hosts.plug()
        end = time.monotonic_ns()
        for lane in LANES:
            wait_for_accepted(witness, lane, 12, since=end)

    for lane in LANES:
        verdicts = one_each(witness, lane)
        # Those that came to the outfeed eye and to the rejector while the cable was out.
        lost = [v for v in verdicts if begin < passed(witness, v) and told_at(witness, v) < end]
        back = [v for v in verdicts if v['decision'] == Decision.ACCEPT and v['came'] > end]
        in_time = sum(not v['late'] for v in verdicts)
        print(
            f'\n{lane}: {len(verdicts)} items, {len(lost)} in the outage, {in_time} verdicts in '
            f'time, weighed again {(min(v["came"] for v in back) - end) / 1e9:.1f} s after it'
        )
        assert len(lost) >= 2
        if lane == 'lane1':  # the reject node is where the eyes are
            assert all(v['reasons'] == ['NoEstimate'] and not v['late'] for v in lost)
            assert in_time == len(verdicts)
        else:  # it hears of the items when they have gone
            assert all(v['late'] for v in lost)
        for v in verdicts:
            # The witness itself may be half a second behind.
            assert v['late'] or v['came'] < told_at(witness, v) + NANOSECONDS // 2
        accepted = [v for v in verdicts if v['decision'] == Decision.ACCEPT]
        masses = offline_masses(len(verdicts) + 10)
        before = [v for v in accepted if v['came'] < begin]
        assert [v['mass'] for v in before] == [masses[v['t1']] for v in before]
        # Edges that came more than edge_lateness after their samples took moments from the zero.
        for v in accepted:
            assert abs(v['mass'] - masses[v['t1']]) < v['std_dev']
        assert [v['decision'] for v in verdicts[-5:]] == [Decision.ACCEPT] * 5


def wait_for_accepted(witness: Witness, lane: str, count: int, since: int = 0) -> None:
    """Wait for so many accepted items of a lane whose verdict came after a time."""
    end = time.monotonic() + PATIENCE
    while True:
        told = list(witness.verdicts[lane])
        accepted = [v for v in told if v['decision'] == Decision.ACCEPT and v['came'] > since]
        if len(accepted) >= count:
            return
        assert time.monotonic() < end, f'{lane}: {len(accepted)} of {count} accepted'
        time.sleep(0.05)


def one_each(witness: Witness, lane: str) -> list[Told]:
    """Return the verdicts from the first accepted item on; each item has to have one."""
    verdicts = sorted(witness.verdicts[lane], key=lambda verdict: verdict['item_id'])
    while verdicts[0]['decision'] != Decision.ACCEPT:  # the nodes were starting
        del verdicts[0]
    first, last = verdicts[0]['t1'], verdicts[-1]['t1']
    entries = [
        edge['stamp']
        for edge in witness.edges[lane]
        if edge['eye'] == Eye.INFEED and edge['blocked'] and first <= edge['stamp'] <= last
    ]
    assert [verdict['t1'] for verdict in verdicts] == sorted(entries)
    return verdicts


def passed(witness: Witness, verdict: Told) -> int:
    """Return when an item was at the outfeed eye, ns of the machine's clock."""
    edges = witness.edges[verdict['lane']]
    return verdict['t3'] + min(edge['came'] - edge['stamp'] for edge in edges)


def told_at(witness: Witness, verdict: Told) -> int:
    """Return when the rejector has to be told of an item, ns of the machine's clock."""
    return passed(witness, verdict) + verdict['reject_at'] - verdict['t3']


def offline_masses(count: int) -> dict[int, float]:
    """Return the masses of the simulated line by t1."""
    parameters = SimulationParameters.from_mapping({**SOURCE, 'count': count})
    return {told['t1']: told['mass'] for told in offline_verdicts(simulate(parameters))}

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes over four hosts whose network loses, delays, reorders, and falls apart for a while."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import subprocess
import sys
import threading
import time
from typing import Any

from network import Network, NoNetworkError, network
from processes import parameter_file
import pytest
from running import PATIENCE, ROOT

from checkweigher_bringup.hosts.description import Share
from checkweigher_bringup.hosts.running import share_command
from checkweigher_bringup.spinning import running_processes
from checkweigher_dsp.records import Decision, Eye
from checkweigher_dsp.ros import ports

HOSTS = 4
ON_MACHINE, AWAY = ('driver', 'reject'), ('segmenter', 'denoise', 'identifier')
# Of 1.5 s between outfeed eye and rejector, half a second is for a busy machine.
VALUES: dict[str, dict[str, object]] = {
    'driver': {
        'simulator.count': 0, 'simulator.masses': [0.1, 0.15, 0.2], 'simulator.lead_in': 15.0,
        'simulator.spacing': 2.0, 'lossless': False,
    },
    'reject': {'rejector_distance': 1.5, 'verdict_margin': 0.5},
}  # fmt: skip
OUTAGE = 8.0  # s
WEIGHED = 3  # items of each lane, before and after


class Witness:
    """What came of the lanes of a host, told on that host itself."""

    def __init__(self, words: list[str], lanes: list[str]) -> None:
        script = str(ROOT / 'test/support/witness.py')
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [*words, sys.executable, script, *lanes], stdin=pipe, stdout=pipe
        )
        self.told: dict[str, list[dict[str, Any]]] = {lane: [] for lane in lanes}
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            told = json.loads(line)
            if told['topic'] != 'ready':
                self.told[told['lane']].append(told)

    def end(self) -> None:
        self._process.communicate(timeout=PATIENCE)
        self._thread.join(timeout=PATIENCE)


@contextmanager
def lanes_over(
    hosts: Network, count: int, folder: Path, environment: dict[str, str]
) -> Iterator[dict[str, Witness]]:
    """Run lanes whose machine is on one host and whose computing is on the next one."""
    file = parameter_file(folder / 'lane.yaml', VALUES)
    places = {f'lane{number}': number % HOSTS for number in range(count)}
    commands = {}
    for lane, place in places.items():
        for host, nodes in ((place, ON_MACHINE), ((place + 1) % HOSTS, AWAY)):
            command = share_command(Share(lane, nodes, (file,), {}))
            commands[f'{lane} {nodes}'] = [*hosts.command(host, **environment), *command]
    of_hosts = [[lane for lane, place in places.items() if place == host] for host in range(HOSTS)]
    witnesses = [
        Witness(hosts.command(host, **environment), lanes) for host, lanes in enumerate(of_hosts)
    ]
    try:
        with running_processes(commands) as processes:
            yield {lane: witnesses[place] for lane, place in places.items()}
            ended = [name for name, each in processes.items() if each.poll() is not None]
            assert not ended
    finally:
        for witness in witnesses:
            witness.end()


def verdicts(told: list[dict[str, Any]], since: int = 0) -> list[dict[str, Any]]:
    return [t for t in told if t['topic'] == ports.VERDICT.name and t['came'] >= since]


def accepted(told: list[dict[str, Any]], since: int = 0) -> int:
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


def check(lane: str, told: list[dict[str, Any]], begin: int, end: int) -> Counter[str]:
    """Check the verdicts of a lane; count them by what they are."""
    given = sorted(verdicts(told), key=lambda verdict: verdict['item_id'])
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
    try:
        with (
            network(HOSTS) as hosts,
            hosts.discovery(discovery) as environment,
            lanes_over(hosts, count, folder, environment) as witnesses,
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

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Endurance tests of the gateways beside a line."""

from collections import Counter, defaultdict
from contextlib import ExitStack, closing, suppress
from http.client import HTTPException
from itertools import pairwise
import math
import os
from pathlib import Path
import signal
import socket
import threading
import time
from urllib.request import urlopen

from authority import Authority
from foreign_plant import CLIENTS, build, running
from gateway_process import LANE, MODULE, Verdicts, gateway, line_values
from mqtt_plant import Host, Link, broker, needs_mosquitto
from node_process import spinning
import numpy as np
from prometheus_client.parser import text_string_to_metric_families
import pytest
from running import children, free_port, wait_for
from served_page import line_of
import yaml

from checkweigher_core.records import Verdict, seconds
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.ports import VERDICT
from checkweigher_gateways.nodesets import default_folder
from checkweigher_web.access.users import Role, User, hash_password, write_users

pytestmark = pytest.mark.soak
_PASSWORD = 'correct horse'
_LINE = 'checkweigher_bringup.line'
_SECONDS = float(os.environ.get('CHECKWEIGHER_SOAK_SECONDS', '300'))


@needs_mosquitto
def test_each_item_comes_once_while_broker_and_gateway_are_killed_again_and_again(
    verdicts: Verdicts, tmp_path: Path
):
    """The broker keeps its retained messages here; it is away every other time."""
    came: Counter[int] = Counter()
    texts: Counter[int] = Counter()
    memory: list[int] = []
    begin = verdicts.more(1)[0].item_id
    end, kills = time.monotonic() + _SECONDS, 0
    keep = 'persistence true', f'persistence_location {tmp_path}/', 'autosave_interval 1'
    with broker(tmp_path, *keep) as its:
        while time.monotonic() < end:
            host = Host(its.port)
            settings = {'port': its.port, 'node': 'host1', 'site': 'plant'}
            with ExitStack() as stack:
                process, _ = stack.enter_context(gateway('mqtt', tmp_path, settings))
                wait_for(lambda host=host: host.of('DBIRTH'))
                verdicts.more(30)
                memory.append(_memory(process.pid))
                if kills % 2:
                    host.close()
                    its.kill()
                    verdicts.more(20)
            if not kills % 2:
                time.sleep(1.0)  # what the broker has is on its way to the host
                host.close()
            host.check_sequences()
            data = [each for each in host.of('DDATA') if 'Item/Id' in each.metrics]
            came.update(each.value('Item/Id') for each in data)
            texts.update(each['item'] for each in host.json[f'{LANE}/verdict'])
            if kills % 2:
                its.start()
            kills += 1
        host = Host(its.port)
        with gateway('mqtt', tmp_path, settings):
            last = verdicts.more(1)[-1].item_id
            wait_for(lambda: any(each['item'] == last for each in host.json[f'{LANE}/verdict']))
        data = [each for each in host.of('DDATA') if 'Item/Id' in each.metrics]
        came.update(each.value('Item/Id') for each in data)
        texts.update(each['item'] for each in host.json[f'{LANE}/verdict'])
        host.close()
    numbers = range(begin, last + 1)
    doubled = sum(came[number] > 1 for number in numbers)
    assert [number for number in numbers if not came[number]] == []
    assert [number for number in numbers if not texts[number]] == []
    # Items that were in transit when a connection broke may arrive twice.
    assert doubled <= kills
    assert max(memory) - min(memory) < 20_000
    print(f'{len(numbers)} items, {kills} kills, {doubled} twice, {max(memory) / 1000:.0f} MB')


class Scraper:
    """Reader of the metrics every 2 s, with the number of items that each gateway has counted."""

    def __init__(self, port: int) -> None:
        self.read: list[tuple[int, int]] = []  # items counted, time of the last item in ms
        self._port, self._ended = port, threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while not self._ended.wait(2.0):
            with suppress(OSError, HTTPException):
                with urlopen(f'http://127.0.0.1:{self._port}/metrics', timeout=1.0) as answer:
                    page = answer.read().decode()
                samples = [
                    each
                    for family in text_string_to_metric_families(page)
                    for each in family.samples
                    if each.labels.get('lane') == LANE
                ]
                count = sum(e.value for e in samples if e.name == 'checkweigher_items_total')
                last = [e for e in samples if e.name == 'checkweigher_last_item_timestamp_seconds']
                if last:
                    self.read.append((int(count), round(1000 * last[0].value)))

    def check(self, verdicts: list[Verdict]) -> int:
        """Check that no gateway missed an item between its reads, and return the number of reads.

        An item may arrive while a page is made. Its count then lacks the item, whose time it has.
        This cannot hold for two reads in succession, 2 s apart, unless an item was missed.
        """
        place = {round(1000 * seconds(each.t3)): n for n, each in enumerate(verdicts) if each.t3}
        runs: list[list[int]] = []  # of each run of the gateway: count minus place of the last item
        before = math.inf
        for count, last in self.read:
            if count < before:
                runs.append([])
            runs[-1].append(count - place[last])
            before = count
        for run in runs:
            assert {max(pair) for pair in pairwise(run)} <= {max(run)}
        return len(self.read)

    def end(self) -> None:
        """Stop reading."""
        self._ended.set()


class Listener(PortNode):
    """Verdicts of a lane, with the time in s from t3 to the arrival of each."""

    def __init__(self, lane: str) -> None:
        super().__init__('listener', namespace=f'/{lane}')
        self.taken: list[Verdict] = []
        self.latencies: dict[int, float] = {}
        self.subscribe(VERDICT, self._take)

    def _take(self, verdict: Verdict) -> None:
        self.taken.append(verdict)
        if verdict.t3:
            self.latencies[verdict.item_id] = time.time() - seconds(verdict.t3)


def plain(verdict: Verdict) -> tuple[object, ...]:
    """Return number, mass in kg to 1 ug, decision and reasons of a verdict.

    The last digits of a mass depend on how the samples are divided into messages.
    """
    return verdict.item_id, f'{verdict.mass:.9f}', verdict.decision, verdict.reasons


@needs_mosquitto
@pytest.mark.skipif(not default_folder().exists(), reason='setup/nodesets has not been run')
def test_each_item_comes_once_through_all_gateways_and_the_line_does_not_notice(tmp_path: Path):
    """Two lines with the same items, 200 per minute, one of them with all gateways.

    About every 25 s, a gateway is killed, or cut off for 8 s.
    """
    (milo,) = (each for each in CLIENTS if each.library == 'Eclipse Milo')
    build(milo)
    plant = Authority(tmp_path)
    own, mine = plant.pair('server', 'urn:checkweigher'), plant.pair('mine', 'urn:plant:client')
    (tmp_path / 'trusted').mkdir()
    (tmp_path / 'trusted/plant.pem').write_bytes(plant.certificate.read_bytes())
    known = hash_password('x', _PASSWORD)
    write_users(tmp_path / 'users', {'vera': User('vera', Role.VIEWER, known)})
    with ExitStack() as stack:
        its = stack.enter_context(broker(tmp_path))
        ports = {'metrics': free_port(), 'opcua': free_port()}
        links = {kind: Link(port) for kind, port in {**ports, 'mqtt': its.port}.items()}
        settings = {
            'metrics': {'port': ports['metrics']},
            'mqtt': {'port': links['mqtt'].port, 'node': 'host1', 'site': 'plant'},
            'opcua': {
                'port': ports['opcua'],
                'certificate': str(own.certificate),
                'key': str(own.key),
                'clients': str(tmp_path / 'trusted'),
                'users': str(tmp_path / 'users'),
            },
        }
        file = tmp_path / 'gateways.yaml'
        file.write_text(yaml.safe_dump(settings))
        values = line_values(tmp_path)
        values['driver']['simulator'] |= {'spacing': 0.3, 'product_length': 0.05}
        values['product'] = {}
        spinner = stack.enter_context(spinning())
        listeners, lines = [], []
        for lane, options in ((LANE, ('--gateways', str(file))), ('alone', ())):
            words = tmp_path / f'{lane}.yaml', values, '--namespace', lane, *options
            lines.append(stack.enter_context(line_of(*words)).pid)
            listeners.append(Listener(lane))
            spinner.add(listeners[-1])
        busy, alone = listeners
        nodes = [wait_for(lambda pid=pid: _child(pid, _LINE)) for pid in lines]
        host = stack.enter_context(closing(Host(its.port)))
        scraper = Scraper(links['metrics'].port)
        stack.callback(scraper.end)
        wait_for(lambda: scraper.read and host.of('DBIRTH'), 'the gateways')
        url = f'opc.tcp://127.0.0.1:{links["opcua"].port}/checkweigher'
        wait_for(lambda: _answers(ports['opcua']), 'the gateway opcua', 300)
        words = url, LANE, *mine, 'vera', _PASSWORD, 10**6
        client = stack.enter_context(running(milo, *words))
        wait_for(lambda: client.all('item'), 'an item', 300)
        first = busy.taken[-1].item_id + 1
        memory: dict[str, list[int]] = defaultdict(list)
        kills, end = 0, time.monotonic() + _SECONDS
        while time.monotonic() < end:
            kind, is_kill = ('mqtt', 'opcua', 'metrics')[kills % 3], kills % 2 == 0
            pid = _child(lines[0], MODULE, kind)
            memory['line'].append(_memory(nodes[0]))
            memory['alone'].append(_memory(nodes[1]))
            if pid:
                memory[kind].append(_memory(pid))
            if is_kill and pid:
                os.kill(pid, signal.SIGKILL)
            else:
                links[kind].cut()
                time.sleep(8.0)
                links[kind].restore()
            kills += 1
            time.sleep(20.0 + 0.05 * (kills % 6))  # varied, to hit other phases of an item
        last = busy.taken[-1].item_id
        wait_for(lambda: any(i['item'] >= last for i in host.json[f'{LANE}/verdict']), 'MQTT', 300)
        wait_for(lambda: max(map(int, client.all('item'))) >= last, 'OPC UA', 300)
        time.sleep(5.0)
    _report(busy, alone, range(first, last + 1), memory, kills)
    taken = {each.item_id: each for each in busy.taken if first <= each.item_id <= last}
    assert list(taken) == list(range(first, last + 1))
    sparkplug = Counter(
        each.value('Item/Id') for each in host.of('DDATA') if 'Item/Id' in each.metrics
    )
    texts = Counter(each['item'] for each in host.json[f'{LANE}/verdict'])
    opcua = Counter(map(int, client.all('item')))
    weighed = [number for number, each in taken.items() if each.mass == each.mass]
    assert {number: opcua[number] for number in weighed} == dict.fromkeys(weighed, 1)
    for came in (sparkplug, texts):
        assert [number for number in taken if not came[number]] == []
        # Items that were in transit when a connection broke may arrive twice.
        doubled = [number for number in taken if came[number] > 1]
        assert len(doubled) <= kills / 3
        print(f'{len(doubled)} twice by MQTT')
    print(f'{scraper.check(busy.taken)} reads of the metrics')
    others = {each.item_id: each for each in alone.taken}
    on_time = [n for n in taken if n in others and not taken[n].late and not others[n].late]
    assert len(on_time) > 0.95 * len(taken)
    assert [plain(taken[n]) for n in on_time] == [plain(others[n]) for n in on_time]
    for values_kb in memory.values():
        rest = values_kb[len(values_kb) // 3 :]
        assert max(rest) - min(rest) < 30_000


def _answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(('127.0.0.1', port), 1.0):
        return True
    return False


def _child(process: int, *words: str) -> int:
    """Return the child of a process with these words in its command, 0 while there is none."""
    for child in children(process):
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
            command = Path(f'/proc/{child}/cmdline').read_text(encoding='utf-8').split('\0')
            if set(words) <= set(command):
                return child
    return 0


def _memory(process: int) -> int:
    """Return the resident memory of a process in kB."""
    status = Path(f'/proc/{process}/status').read_text(encoding='ascii')
    return int(status.partition('VmRSS:')[2].split()[0])


def _report(
    busy: Listener, alone: Listener, numbers: range, memory: dict[str, list[int]], kills: int
) -> None:
    pairs = [
        (busy.latencies[n], alone.latencies[n])
        for n in numbers
        if n in busy.latencies and n in alone.latencies
    ]
    with_all, without = np.transpose(pairs)
    for name, latency in (('with', with_all), ('without', without), ('more', with_all - without)):
        p50, p99 = 1000 * np.percentile(latency, [50, 99])
        print(f'{name}: median {p50:.1f} ms, 99 % {p99:.1f} ms, max {1000 * latency.max():.1f} ms')
    late = [sum(each.late for each in its.taken) for its in (busy, alone)]
    print(f'{len(numbers)} items, {kills} kills and cuts, late {late}, load {os.getloadavg()}')
    print({kind: (its[0], min(its), max(its), its[-1]) for kind, its in memory.items()}, 'kB')

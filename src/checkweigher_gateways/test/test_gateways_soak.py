# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gateways beside a line for long, with clients of other makers."""

from collections import Counter
from contextlib import ExitStack
import json
import os
from pathlib import Path
import shutil
import subprocess
import time

from gateway_process import LANE, Verdicts, gateway
from mqtt_plant import Host, broker, needs_mosquitto
import pytest
from running import ROOT, wait_for

from checkweigher_gateways.nodesets import default_folder
from checkweigher_web.access.users import Role, User, hash_password, write_users

pytestmark = pytest.mark.soak
_CLIENT = 'node-opcua-client@2.186.4'
_SECONDS = float(os.environ.get('CHECKWEIGHER_SOAK_SECONDS', '300'))
_PASSWORD = 'correct horse'


@pytest.mark.skipif(shutil.which('npm') is None, reason='there is no npm')
@pytest.mark.skipif(not default_folder().exists(), reason='setup/nodesets has not been run')
def test_a_client_of_another_maker_sees_each_item(verdicts: Verdicts, tmp_path: Path):
    install = ['npm', 'install', '--silent', '--no-save', '--prefix', str(tmp_path), _CLIENT]
    subprocess.run(install, check=True)
    users = tmp_path / 'users'
    write_users(users, {'anna': User('anna', Role.OPERATOR, hash_password('anna', _PASSWORD))})
    with gateway('opcua', tmp_path, {'port': 0, 'users': str(users)}) as (_, url):
        verdicts.more(5)
        words = ['node', ROOT / 'test/support/opcua_client.js', url, LANE, 40, 'anna', _PASSWORD]
        node_path = {**os.environ, 'NODE_PATH': str(tmp_path / 'node_modules')}
        done = subprocess.run(
            list(map(str, words)), env=node_path, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout.splitlines()[-1])
        assert set(found['needed']) - {'<ListOfWeighingRanges>'} <= set(found['nodes'])
        items = [int(each) for each in found['items'] if each]
        weighed = [each.item_id for each in verdicts.taken if each.mass == each.mass]
        begin = weighed.index(items[0])
        assert items == weighed[begin : begin + len(items)]
        assert found['anonymous'] == 'BadUserAccessDenied'
        assert found['operator'] == 'Good'
        print(f'{len(items)} items, {len(found["needed"])} mandatory nodes')


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
                status = Path(f'/proc/{process.pid}/status').read_text(encoding='ascii')
                memory.append(int(status.partition('VmRSS:')[2].split()[0]))
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
    # Items that were on their way when a connection broke may come twice.
    assert doubled <= kills
    assert max(memory) - min(memory) < 20_000
    print(f'{len(numbers)} items, {kills} kills, {doubled} twice, {max(memory) / 1000:.0f} MB')

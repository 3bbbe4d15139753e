# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gateways beside a line for long."""

from collections import Counter
from contextlib import ExitStack
import os
from pathlib import Path
import time

from gateway_process import LANE, Verdicts, gateway
from mqtt_plant import Host, broker, needs_mosquitto
import pytest
from running import wait_for

pytestmark = pytest.mark.soak
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

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts of a line that runs, at a broker and a host of Sparkplug B."""

import asyncio
from collections import Counter
from collections.abc import Callable
import contextlib
from pathlib import Path
import signal
import time

from authority import Authority
from gateway_process import LANE, Verdicts, gateway
from mqtt_plant import Host, Link, broker, needs_mosquitto
import pytest
from running import wait_for

from checkweigher_core.health.findings import Level
from checkweigher_core.records import Verdict
from checkweigher_gateways.gateway import GatewayError
from checkweigher_gateways.mqtt import make
from checkweigher_gateways.settings import GatewaySettings, MqttSettings

pytestmark = needs_mosquitto
NODE = 'host1'
OF_LANE = f'{LANE}/verdict'


def items(host: Host) -> list[int]:
    """Return the numbers of the items that came by DDATA."""
    return [each.value('Item/Id') for each in host.of('DDATA') if 'Item/Id' in each.metrics]


def wait_until_delivered(host: Host, verdicts: Verdicts) -> None:
    """Wait until the latest verdict has come, and the message that follows it.

    If the connection breaks before that message, an item may come twice (docs/plant.md).
    """

    def delivered() -> bool:
        sent = host.json[OF_LANE][-1]
        follows = host.json['delivered'][-1]['number'] == sent['number']
        return follows and bool(sent['item'] == verdicts.taken[-1].item_id)

    wait_for(delivered)


def check_item(host: Host, verdict: Verdict) -> None:
    """Check that one DDATA and one JSON text say what the verdict says."""
    (data,) = [
        each
        for each in host.of('DDATA')
        if 'Item/Id' in each.metrics and each.value('Item/Id') == verdict.item_id
    ]
    assert data.value('Item/Mass') == pytest.approx(verdict.mass, rel=1e-12)
    assert data.value('Item/Decision') == verdict.decision.name
    assert data.value('Item/Reasons') == ','.join(verdict.reasons)
    assert data.metrics['Item/Mass'].timestamp == (verdict.t3 or 0) // 1_000_000
    (text,) = [each for each in host.json[OF_LANE] if each['item'] == verdict.item_id]
    assert (text['mass_kg'], text['stamp_ns']) == (verdict.mass, verdict.t3)
    assert text['reasons'] == list(verdict.reasons)


def test_each_item_comes_once_though_the_gateway_is_cut_off_and_killed(
    verdicts: Verdicts, tmp_path: Path
):
    with broker(tmp_path) as its, contextlib.closing(Host(its.port)) as host:
        link = Link(its.port)
        link.cut()
        settings = {'port': link.port, 'node': NODE, 'site': 'plant', 'commands': True}
        with gateway('mqtt', tmp_path, settings) as (process, _):
            verdicts.more(8)  # it begins without a broker
            link.restore()
            wait_for(lambda: items(host), 'an item')
            first = verdicts.more(3)[0].item_id
            wait_for(lambda: first in items(host))
            (node,), (device,) = host.of('NBIRTH'), host.of('DBIRTH')
            assert node.value('Node Control/Rebirth') is False
            assert set(host.of('DDATA')[-1].metrics) <= set(device.metrics)
            assert {'State', 'Stop/Reason', 'Zero/Offset', 'Command/Zero'} <= set(device.metrics)
            host.send(f'spBv1.0/plant/NCMD/{NODE}', Node_Control__Rebirth=True)
            wait_for(lambda: len(host.of('DBIRTH')) == 2)
            # The gateway ignores a command for an unknown lane, and JSON that is not a command.
            host.send(f'spBv1.0/plant/DCMD/{NODE}/nobody', Command__Zero=True)
            host.client.publish(f'checkweigher/{NODE}/{LANE}/command', '[1]').wait_for_publish()
            host.send(f'spBv1.0/plant/DCMD/{NODE}/{LANE}', Command__Zero=True)
            wait_for(lambda: host.json[f'{LANE}/answer'])
            assert host.json[f'{LANE}/answer'][0]['what'] == 'zero'
            # Hung and cut off, back, cut off again, then killed.
            wait_until_delivered(host, verdicts)
            process.send_signal(signal.SIGSTOP)
            hung = verdicts.more(3)[0].item_id
            link.cut()
            process.send_signal(signal.SIGCONT)
            wait_for(lambda: host.of('NDEATH'))
            link.restore()
            wait_for(lambda: hung in items(host), f'item {hung}')
            wait_until_delivered(host, verdicts)
            link.cut()
            away = verdicts.more(3)[1].item_id
            process.kill()
            verdicts.go_on()
        link.restore()
        born = len(host.of('NBIRTH'))
        with gateway('mqtt', tmp_path, settings):
            wait_for(lambda: len(host.of('DBIRTH')) > born)
            birth = host.of('NBIRTH')[-1].metrics['bdSeq']
            # The stamps of a simulator lag behind the clock of a busy machine.
            wait_for(lambda: (verdicts.taken[-1].t3 or 0) > birth.timestamp * 1_000_000)
            last = verdicts.taken[-1].item_id
            wait_for(lambda: last in items(host), f'item {last}')
            wait_for(lambda: any(each['item'] == last for each in host.json[OF_LANE]))
        taken = [each for each in verdicts.taken if first <= each.item_id <= last]
        came = Counter(items(host))
        assert {each.item_id: came[each.item_id] for each in taken} == {
            each.item_id: 1 for each in taken
        }
        for each in taken:
            check_item(host, each)
        historical = {
            each.value('Item/Id'): each.metrics['Item/Id'].is_historical
            for each in host.of('DDATA')
            if 'Item/Id' in each.metrics
        }
        assert historical[away]
        assert not historical[last]
        sequence = [each.value('bdSeq') for each in host.of('NBIRTH')]
        assert sequence == sorted(sequence)
        assert len(set(sequence)) == 3  # a birth that was asked for keeps its number
        host.check_sequences()


def test_a_file_of_a_password_that_cannot_be_read_is_named(tmp_path: Path):
    password, store = str(tmp_path / 'none'), str(tmp_path / 'store')
    settings = MqttSettings(user='line', password_file=password, store=store)
    with pytest.raises(GatewayError, match=r'mqtt: .* password_file: .*/none'):
        asyncio.run(make(GatewaySettings(mqtt=settings)).start())


async def _turned(settings: MqttSettings, done: Callable[[], object]) -> tuple[Level, str]:
    """Run a gateway without a line for some turns; return its finding."""
    made = make(GatewaySettings(mqtt=settings))
    await made.start()
    end = time.monotonic() + 20
    while time.monotonic() < end and not done():
        await made.turn()
        await asyncio.sleep(0.05)
    (finding,) = made.findings(time.monotonic())
    await made.close()
    return finding.level, finding.text


def test_the_broker_asks_for_the_certificate_of_the_plant(tmp_path: Path):
    plant, other = Authority(tmp_path), Authority(tmp_path, 'other')
    own, mine, wrong = plant.pair('broker'), plant.pair('gateway'), other.pair('stranger')
    tls = (
        f'cafile {plant.certificate}',
        f'certfile {own.certificate}',
        f'keyfile {own.key}',
        'require_certificate true',
    )
    with broker(tmp_path, *tls) as its:
        host = Host(its.port, mine, plant.certificate)

        def settings(pair: tuple[Path, Path]) -> MqttSettings:
            certificate, key = map(str, pair)
            store, authority = str(tmp_path / 'store'), str(plant.certificate)
            return MqttSettings(
                host='localhost', port=its.port, node=NODE, store=store,
                authority=authority, certificate=certificate, key=key,
            )  # fmt: skip

        level, text = asyncio.run(_turned(settings(mine), lambda: host.json['online']))
        assert (level, text) == (Level.OK, f'connected to localhost:{its.port}')
        wait_for(lambda: host.json['online'] == [True, False])
        end = time.monotonic() + 3
        level, text = asyncio.run(_turned(settings(wrong), lambda: time.monotonic() > end))
        assert level == Level.ERROR
        assert text.endswith('0 items wait')
        assert host.json['online'] == [True, False]
        host.close()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""OPC UA clients and Sparkplug B hosts of other makers, connected to the gateways of a line."""

from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from authority import Authority
from foreign_plant import CLIENTS, HOSTS, Program, build, running
from gateway_process import LANE, Verdicts, gateway
from mqtt_plant import Link, broker, needs_mosquitto
import pytest
from running import PATIENCE, free_port, wait_for

from checkweigher_gateways.nodesets import default_folder
from checkweigher_web.access.users import Role, User, hash_password, write_users

PASSWORD = 'correct horse'
LONG = 3 * PATIENCE
needs_nodesets = pytest.mark.skipif(
    not default_folder().exists(), reason='setup/nodesets has not been run'
)
clients = pytest.mark.parametrize('client', CLIENTS, ids=lambda each: each.library)
hosts = pytest.mark.parametrize('host', HOSTS, ids=lambda each: each.library)


def need_built(program: Program) -> None:
    """Skip a test whose program was not built."""
    if not program.folder.is_built:
        pytest.skip(f'{program.library}: `make soak` builds {program.folder.path.name}')


def check_client(client: Program, verdicts: Verdicts, folder: Path, kills: int) -> str:
    """Check what a client receives and may do, while the gateway is killed `kills` times."""
    plant, other = Authority(folder), Authority(folder, 'other')
    own = plant.pair('server', uri='urn:checkweigher')
    mine, stranger = (
        each.pair(name, uri='urn:plant:client') for each, name in ((plant, 'mine'), (other, 'no'))
    )
    (folder / 'trusted').mkdir()
    (folder / 'trusted/plant.pem').write_bytes(plant.certificate.read_bytes())
    roles = {'vera': Role.VIEWER, 'anna': Role.OPERATOR}
    known = hash_password('x', PASSWORD)
    write_users(folder / 'users', {name: User(name, role, known) for name, role in roles.items()})
    settings = {
        'port': free_port(),
        'certificate': str(own.certificate),
        'key': str(own.key),
        'clients': str(folder / 'trusted'),
        'users': str(folder / 'users'),
    }
    count = 10 * (kills + 1)
    with ExitStack() as stack:
        with gateway('opcua', folder, settings) as (_, url):
            verdicts.more(3)
            with running(client, url, LANE, *stranger, 'anna', PASSWORD, 0) as refused:
                assert refused.ended(LONG) == 1
                assert refused.all('refused')
            with running(client, url, LANE, *mine, 'anna', 'wrong', 0) as refused:
                assert refused.ended(LONG) == 1
            with running(client, url, LANE, *mine, 'vera', PASSWORD, 0) as viewer:
                assert viewer.ended(LONG) == 0
                assert viewer.all('select') == ['BadUserAccessDenied']
            words = url, LANE, *mine, 'anna', PASSWORD, count
            its = stack.enter_context(running(client, *words))
            wait_for(lambda: len(its.all('item')) >= 5, 'items', LONG)
        for each in range(kills):
            verdicts.more(4)
            with gateway('opcua', folder, settings):
                wanted = count if each == kills - 1 else 10 * (each + 1) + 5
                wait_for(lambda wanted=wanted: len(its.all('item')) >= wanted, 'items', LONG)
                if wanted == count:
                    assert its.ended(LONG) == 0
    assert its.all('select') == its.all('acknowledged') == its.all('unhold') == ['Good']
    assert its.all('alarm') == ['TooManyRejects']
    (needed,) = its.all('needed')
    assert set(needed) - {'<ListOfWeighingRanges>'} <= set(its.all('nodes')[0])
    items = [int(each) for each in its.all('item')]
    weighed = {each.item_id: each.mass for each in verdicts.taken if each.mass == each.mass}
    numbers = list(weighed)
    begin = numbers.index(items[0])
    assert items == numbers[begin : begin + len(items)]
    assert len(items) >= count
    assert its.all('gross')[0] in weighed.values()
    return f'{client.library}: {len(items)} items, {kills} kills, {len(needed)} mandatory nodes'


@needs_nodesets
@clients
def test_a_client_of_another_maker(client: Program, verdicts: Verdicts, tmp_path: Path):
    need_built(client)
    check_client(client, verdicts, tmp_path, 1)


@pytest.mark.soak
@needs_nodesets
@clients
def test_a_client_of_another_maker_over_kills(client: Program, verdicts: Verdicts, tmp_path: Path):
    build(client)
    print(check_client(client, verdicts, tmp_path, 10))


def check_host(host: Program, verdicts: Verdicts, folder: Path, cuts: int) -> str:
    """Check what a host decodes, while the gateway is cut off `cuts` times and killed once."""
    with broker(folder) as its, running(host, its.port, 'plant', 'host1') as plant:

        def kinds(kind: str) -> int:
            return plant.all('kind').count(kind)

        def of_items() -> list[dict[str, Any]]:
            data = [each for each in list(plant.said) if each['kind'] == 'DDATA']
            return [each for each in data if 'Item/Id' in each['metrics']]

        def items() -> dict[int, bool]:
            return {
                int(each['metrics']['Item/Id']): 'Item/Id' in each['historical']
                for each in of_items()
            }

        wait_for(lambda: kinds('connected'), 'the host', LONG)
        link = Link(its.port)
        settings = {'port': link.port, 'node': 'host1', 'site': 'plant'}
        with gateway('mqtt', folder, settings):
            first = verdicts.more(2)[0].item_id
            wait_for(lambda: kinds('NBIRTH') and kinds('DBIRTH') and first in items())
            births = kinds('DBIRTH')
            plant.write_line()
            wait_for(lambda: kinds('DBIRTH') > births, 'a rebirth')
            away = []
            for _ in range(cuts):
                link.cut()
                away.append(verdicts.more(3)[1].item_id)
                deaths = len(away)
                wait_for(lambda deaths=deaths: kinds('NDEATH') >= deaths)
                link.restore()
                wait_for(lambda: away[-1] in items())
        wait_for(lambda: kinds('NDEATH') > cuts)
        away.append(verdicts.more(3)[1].item_id)
        with gateway('mqtt', folder, settings):
            wait_for(lambda: away[-1] in items())
            last = verdicts.more(1)[-1].item_id
            wait_for(lambda: last in items())
        came = Counter(int(each['metrics']['Item/Id']) for each in of_items())
        taken = {each.item_id: each for each in verdicts.taken if first <= each.item_id <= last}
        assert {number: came[number] for number in taken} == dict.fromkeys(taken, 1)
        assert all(items()[number] for number in away)
        for metrics in (each['metrics'] for each in of_items()):
            if (verdict := taken.get(metrics['Item/Id'])) is not None:
                mass = metrics['Item/Mass']
                assert mass == (verdict.mass if verdict.mass == verdict.mass else None)
                assert metrics['Item/Decision'] == verdict.decision.name
        (birth, *_) = [each['metrics'] for each in plant.said if each['kind'] == 'DBIRTH']
        assert {'State', 'Stop/Reason', 'Zero/Offset', 'Item/Mass'} <= set(birth)
        numbers = {
            kind: [
                each['metrics']['bdSeq']
                for each in plant.said
                if each['kind'] == kind and 'bdSeq' in each['metrics']
            ]
            for kind in ('NBIRTH', 'NDEATH')
        }
        assert set(numbers['NDEATH']) <= set(numbers['NBIRTH'])
        return (
            f'{host.library}: {len(taken)} items, {cuts} cuts, {sum(items().values())} historical'
        )


@needs_mosquitto
@hosts
def test_a_host_of_another_maker(host: Program, verdicts: Verdicts, tmp_path: Path):
    need_built(host)
    check_host(host, verdicts, tmp_path, 1)


@pytest.mark.soak
@needs_mosquitto
@hosts
def test_a_host_of_another_maker_over_cuts(host: Program, verdicts: Verdicts, tmp_path: Path):
    build(host)
    print(check_host(host, verdicts, tmp_path, 10))

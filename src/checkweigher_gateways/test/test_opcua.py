# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line that runs, as a checkweigher of OPC UA."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
import signal
import time
from typing import Any

from asyncua import Client, Node, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from authority import Authority, Pair
from gateway_process import LANE, PRODUCTS, Verdicts, gateway
import pytest
from running import PATIENCE

from checkweigher_core.records import Decision
from checkweigher_gateways.gateway import GatewayError
from checkweigher_gateways.nodesets import default_folder
from checkweigher_gateways.opcua import make
from checkweigher_gateways.opcua_access import Users
from checkweigher_gateways.settings import GatewaySettings, OpcuaSettings
from checkweigher_production.audit_log import read_log
from checkweigher_web.access.users import Role, User, UserFile, hash_password, write_users

PASSWORD = 'correct horse'
SCALES = 'http://opcfoundation.org/UA/Scales/V2/'
needs_nodesets = pytest.mark.skipif(
    not (default_folder() / 'Opc.Ua.Scales.NodeSet2.xml').exists(),
    reason='setup/nodesets has not been run',
)


@pytest.fixture(scope='module')
def users(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('users') / 'users'
    known = hash_password('x', PASSWORD)
    roles = {'anna': Role.OPERATOR, 'ben': Role.TECHNICIAN}
    write_users(path, {name: User(name, role, known) for name, role in roles.items()})
    return path


class Heard:
    """Values and events that a subscription has brought."""

    def __init__(self) -> None:
        self.values: list[Any] = []
        self.events: list[Any] = []

    def datachange_notification(self, node: Node, value: Any, data: Any) -> None:
        self.values.append((value, data.monitored_item.Value.SourceTimestamp))

    def event_notification(self, event: Any) -> None:
        self.events.append(event)


async def until(condition: Callable[[], Any], what: str = 'a condition') -> Any:
    end = time.monotonic() + 2 * PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, f'waited in vain for {what}'
        await asyncio.sleep(0.02)
    return found


async def refusal(call: Awaitable[Any]) -> int:
    """Return the status code with which a call is refused."""
    with pytest.raises(ua.UaStatusCodeError) as error:
        await call
    return int(error.value.code)


async def mandatory(kind: Node) -> set[str]:
    """Return the names that each instance of a type must have, as its models say."""
    found: set[str] = set()
    for child in await kind.get_children():
        rules = await child.get_referenced_nodes(ua.ObjectIds.HasModellingRule)
        names = {(await rule.read_browse_name()).Name for rule in rules}
        if 'Mandatory' in names:
            found.add((await child.read_browse_name()).Name)
    (parent,) = await kind.get_referenced_nodes(ua.ObjectIds.HasSubtype, ua.BrowseDirection.Inverse)
    return found if parent.nodeid == ua.NodeId(58) else found | await mandatory(parent)


async def _check_lane(client: Client, verdicts: Verdicts) -> Node:
    """Check the nodes of the lane against the models, and the items that it shows."""
    own = await client.get_namespace_index('urn:checkweigher')
    scales = await client.get_namespace_index(SCALES)
    await client.load_data_type_definitions()
    machines = await client.nodes.objects.get_child(
        [f'{await client.get_namespace_index("http://opcfoundation.org/UA/Machinery/")}:Machines']
    )
    end = time.monotonic() + PATIENCE
    while LANE not in {
        (await each.read_browse_name()).Name for each in await machines.get_children()
    }:
        assert time.monotonic() < end
        await asyncio.sleep(0.1)
    lane = client.get_node(ua.NodeId(LANE, own))
    assert await lane.read_type_definition() == ua.NodeId(45, scales)
    names = {(await each.read_browse_name()).Name for each in await lane.get_children()}
    assert await mandatory(client.get_node(ua.NodeId(45, scales))) <= names
    assert not any('<' in name for name in names)
    weight = client.get_node(ua.NodeId(f'{LANE}.RegisteredWeight', own))
    heard = Heard()
    subscription = await client.create_subscription(50, heard)
    await subscription.subscribe_data_change(weight, queuesize=100)
    await until(lambda: len(heard.values) > 1)
    begin = heard.values[-1][1]
    await until(lambda: len([v for v in heard.values if v[1] > begin]) >= 4)
    masses = [value.Gross for value, stamp in heard.values if stamp > begin]
    taken = [each.mass for each in verdicts.taken]
    first = taken.index(masses[0])
    assert masses == taken[first : first + len(masses)]
    await subscription.delete()
    return lane


async def _work(url: str, verdicts: Verdicts) -> None:
    """Work as a viewer without a name, as an operator and as a technician."""
    async with Client(url, PATIENCE, PATIENCE) as client:
        lane = await _check_lane(client, verdicts)
        own, scales = lane.nodeid.NamespaceIndex, await client.get_namespace_index(SCALES)

        def node(path: str, of: Client = client) -> Node:
            return of.get_node(ua.NodeId(f'{LANE}.{path}', own))

        preset = 'ProductionPreset'
        select = node(f'{preset}.SelectProduct').nodeid
        denied = ua.StatusCodes.BadUserAccessDenied
        assert await refusal(node(preset).call_method(select, 'heavy')) == denied
        nominal = node(f'{preset}.Products.heavy.NominalWeight')
        assert await nominal.read_value() == PRODUCTS['heavy']['nominal']
        accepted = node(f'{preset}.Products.light.Statistic.TotalPackagesAccepted.ItemCount')
        assert (
            0
            < await accepted.read_value()
            <= len([each for each in verdicts.taken if each.decision == Decision.ACCEPT]) + 100
        )
        state = node('State.MachineState.ExecuteState.CurrentState')
        assert (await state.read_value()).Text == 'Execute'
        heard = Heard()
        subscription = await client.create_subscription(50, heard)
        kinds = [ua.NodeId(13, scales), ua.NodeId(21, scales)]
        await subscription.subscribe_events(lane, kinds)

        operator = Client(url, PATIENCE, PATIENCE)
        operator.set_user('anna')
        operator.set_password(PASSWORD)
        async with operator:
            add = node(f'{preset}.AddProduct').nodeid
            wanted = node(preset, operator)
            assert await refusal(wanted.call_method(add, 'a', 'b', '')) == denied
            await wanted.call_method(select, 'heavy')
            await until(lambda: verdicts.taken[-1].product == 'heavy')
            # Now each item is too light, so the line asks to be stopped.
            stops = await until(
                lambda: [e for e in heard.events if getattr(e, 'ConditionName', '')], 'an alarm'
            )
            alarm = stops[0]
            assert alarm.ConditionName == 'stop TooManyRejects'
            assert alarm.VendorNotificationId == 'TooManyRejects'
            assert (getattr(alarm, 'ActiveState/Id'), getattr(alarm, 'AckedState/Id')) == (
                True,
                False,
            )
            end = time.monotonic() + PATIENCE
            while (await state.read_value()).Text != 'Held':
                assert time.monotonic() < end
                await asyncio.sleep(0.05)
            condition = operator.get_node(alarm.NodeId)
            await condition.call_method(ua.NodeId(9111), alarm.EventId, ua.LocalizedText('seen'))
            await until(lambda: any(getattr(e, 'AckedState/Id', False) for e in heard.events))
            await wanted.call_method(select, 'light')
            unhold = node('State.MachineState.ExecuteState.Unhold')
            await node('State.MachineState.ExecuteState', operator).call_method(unhold.nodeid)
            await until(lambda: verdicts.taken[-1].decision == Decision.ACCEPT)

        technician = Client(url, PATIENCE, PATIENCE)
        technician.set_user('ben')
        technician.set_password(PASSWORD)
        async with technician:
            call = node(preset, technician).call_method(add, 'a', 'b', '')
            assert await refusal(call) == ua.StatusCodes.BadInvalidState
            texts = lambda: [e.Message.Text for e in heard.events]  # noqa: E731
            why = 'add product: products are changed only in the recipe file'
            await until(lambda: why in texts())
        stranger = Client(url, PATIENCE, PATIENCE)
        stranger.set_user('anna')
        stranger.set_password('wrong')
        assert await refusal(stranger.connect()) == denied
    noted = [
        str(each.new)
        for each in read_log(verdicts.folder / 'audit.log').entries
        if (each.kind, each.subject) == ('person', 'anna')
    ]
    assert noted[:2] == ['select product heavy: asked from OPC UA', 'select product heavy: done']


def test_the_encodings_of_a_name_are_one_account_at_the_login(tmp_path: Path):
    path = tmp_path / 'users'
    composed, decomposed = 'andr\u00e9', 'andre\u0301'
    write_users(path, {composed: User(composed, Role.OPERATOR, hash_password('x', PASSWORD))})
    server = Users(UserFile(path))
    assert server.get_user(None, decomposed, PASSWORD) is not None
    for name in (composed, decomposed, composed):
        assert server.get_user(None, name, 'wrong') is None
    # Three failures in all: the next attempt has to wait, also with the right password.
    assert server.get_user(None, decomposed, PASSWORD) is None


@needs_nodesets
def test_clients_see_the_items_and_work_on_the_lane(
    verdicts: Verdicts, tmp_path: Path, users: Path
):
    with gateway('opcua', tmp_path, {'port': 0, 'users': str(users)}) as (process, url):
        asyncio.run(_work(url, verdicts))
        process.send_signal(signal.SIGSTOP)
        verdicts.go_on()
        process.kill()
        verdicts.go_on()


async def _connected(url: str, pair: Pair, server: Path) -> str:
    client = Client(url, PATIENCE, PATIENCE)
    client.application_uri = 'urn:plant:client'
    client.set_user('anna')
    client.set_password(PASSWORD)
    await client.set_security(
        SecurityPolicyBasic256Sha256, pair.certificate, pair.key, server_certificate=server
    )
    async with client:
        return (await client.nodes.server.read_browse_name()).Name


@needs_nodesets
def test_only_clients_with_a_trusted_certificate_come_in(tmp_path: Path, users: Path):
    plant, other = Authority(tmp_path), Authority(tmp_path, 'other')
    own = plant.pair('server', uri='urn:checkweigher')
    client = plant.pair('client', uri='urn:plant:client')
    stranger = other.pair('stranger', uri='urn:plant:client')
    (tmp_path / 'trusted').mkdir()
    (tmp_path / 'trusted/plant.pem').write_bytes(plant.certificate.read_bytes())
    settings = OpcuaSettings(
        port=0,
        certificate=str(own.certificate),
        key=str(own.key),
        clients=str(tmp_path / 'trusted'),
        users=str(users),
    )

    async def run() -> None:
        made = make(GatewaySettings(opcua=settings))
        url = await made.start()
        assert await _connected(url, client, own.certificate) == 'Server'
        untrusted = await refusal(_connected(url, stranger, own.certificate))
        assert untrusted == ua.StatusCodes.BadCertificateUntrusted
        with pytest.raises(ua.UaError):
            await Client(url, PATIENCE, PATIENCE).connect()
        await made.close()

    asyncio.run(run())


def test_what_the_server_lacks_is_one_line(tmp_path: Path):
    for settings, why in (
        (OpcuaSettings(nodesets=str(tmp_path)), 'run setup/nodesets'),
        (OpcuaSettings(host='0.0.0.0'), 'requires certificate, key and clients'),
    ):
        with pytest.raises(GatewayError, match=why) as error:
            asyncio.run(make(GatewaySettings(opcua=settings)).start())
        assert '\n' not in str(error.value)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line that runs, as a checkweigher of OPC UA."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
import signal
import threading
import time
from typing import Any

from asyncua import Client, Node, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from authority import Authority, Pair
from gateway_process import LANE, PRODUCTS, Verdicts, gateway
import pytest
from running import PATIENCE, free_port

from checkweigher_core.records import Decision, Verdict, seconds
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
            await _shown(state, 'Held')
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


async def _methods(node: Node) -> dict[str, tuple[Node, Node]]:
    """Return each method below a node of the lane, and the object that has it, by its name."""
    found: dict[str, tuple[Node, Node]] = {}
    for child in await node.get_children():
        if child.nodeid.NamespaceIndex == node.nodeid.NamespaceIndex:
            if await child.read_node_class() == ua.NodeClass.Method:
                found[str(child.nodeid.Identifier).removeprefix(f'{LANE}.')] = node, child
            else:
                found |= await _methods(child)
    return found


async def _try_methods(url: str) -> None:
    """Check that no method is dead, and that those of PackML act or say why they do not."""
    codes = ua.StatusCodes
    async with Client(url, PATIENCE, PATIENCE) as client:
        own = await client.get_namespace_index('urn:checkweigher')
        lane = client.get_node(ua.NodeId(LANE, own))
        methods = await _methods(lane)
        assert len(methods) > 18
        for owner, method in methods.values():
            assert await refusal(owner.call_method(method)) == codes.BadUserAccessDenied
        for number in (9027, 9028, 9029, 9113):
            call = lane.call_method(ua.NodeId(number), b'', ua.LocalizedText(''))
            assert await refusal(call) == codes.BadNotSupported
        state = client.get_node(ua.NodeId(f'{LANE}.State.MachineState.CurrentState', own))
        heard = Heard()
        subscription = await client.create_subscription(50, heard)
        scales = await client.get_namespace_index(SCALES)
        await subscription.subscribe_events(lane, ua.NodeId(13, scales))
        operator = Client(url, PATIENCE, PATIENCE)
        operator.set_user('anna')
        operator.set_password(PASSWORD)
        async with operator:

            async def call(name: str) -> None:
                owner, method = methods[f'State.{name}']
                await operator.get_node(owner.nodeid).call_method(method.nodeid)

            execute = 'MachineState.ExecuteState'
            for name, why in (
                (f'{execute}.Hold', 'hold: a lane is held only by its own stop request'),
                (f'{execute}.Suspend', 'suspend: a lane is never suspended'),
                (f'{execute}.Unsuspend', 'unsuspend: a lane is never suspended'),
                (f'{execute}.ToComplete', 'complete: a lane has no end of production'),
            ):
                assert await refusal(call(name)) == codes.BadInvalidState
                await until(
                    lambda why=why: any(e.Message.Text.startswith(why) for e in heard.events), why
                )
            for stop in ('MachineState.Stop', 'Abort'):
                await call(stop)
                await _shown(state, 'Stopped')
                await call(f'{execute}.Start')
                await _shown(state, 'Running')
            for reset in (f'{execute}.Reset', f'{execute}.Unhold', 'MachineState.Reset', 'Clear'):
                await call(reset)


async def _shown(node: Node, text: str) -> None:
    """Wait until a node has a text as its value."""
    end = time.monotonic() + PATIENCE
    while (await node.read_value()).Text != text:
        assert time.monotonic() < end, text
        await asyncio.sleep(0.05)


async def _history(url: str, begin: Verdict, end: Verdict) -> list[int]:
    """Return the numbers of the items from `begin` to `end` that the server has kept."""
    since, until = (datetime.fromtimestamp(seconds(each.time), UTC) for each in (begin, end))
    async with Client(url, PATIENCE, PATIENCE) as client:
        own = await client.get_namespace_index('urn:checkweigher')
        node = client.get_node(ua.NodeId(f'{LANE}.RegisteredWeight.WeightId', own))
        latest = time.monotonic() + PATIENCE
        while time.monotonic() < latest:
            with suppress(ua.UaError):  # the server has no lane yet
                if (await node.read_data_value()).SourceTimestamp >= until:
                    break
            await asyncio.sleep(0.1)
        return [int(each.Value.Value) for each in await node.read_raw_history(since, until)]


def test_the_encodings_of_a_name_are_one_account_at_the_login(tmp_path: Path):
    path = tmp_path / 'users'
    composed, decomposed = 'andr\u00e9', 'andre\u0301'
    write_users(path, {composed: User(composed, Role.OPERATOR, hash_password('x', PASSWORD))})
    server = Users(UserFile(path))

    async def run() -> None:
        assert await server.check(decomposed, PASSWORD) is not None
        for name in (composed, decomposed, composed):
            assert await server.check(name, 'wrong') is None
        # Three failures in all: the next attempt has to wait, also with the right password.
        assert await server.check(decomposed, PASSWORD) is None

    asyncio.run(run())


def test_other_clients_are_served_while_a_password_is_checked(
    users: Path, monkeypatch: pytest.MonkeyPatch
):
    served = threading.Event()
    monkeypatch.setattr(User, 'has_password', lambda *_: served.wait(PATIENCE))
    server = Users(UserFile(users))

    async def serve() -> None:
        served.set()

    async def run() -> None:
        user, _ = await asyncio.gather(server.check('anna', PASSWORD), serve())
        assert user is not None

    asyncio.run(run())


@needs_nodesets
def test_clients_see_the_items_and_work_on_the_lane(
    verdicts: Verdicts, tmp_path: Path, users: Path
):
    settings = {'port': free_port(), 'users': str(users)}
    with gateway('opcua', tmp_path, settings) as (process, url):
        asyncio.run(_work(url, verdicts))
        asyncio.run(_try_methods(url))
        begin = verdicts.taken[-1]
        process.send_signal(signal.SIGSTOP)
        verdicts.go_on()
        process.kill()
        verdicts.go_on()
    end = verdicts.taken[-1]
    with gateway('opcua', tmp_path, settings) as (_, url):
        items = asyncio.run(_history(url, begin, end))
    weighed = [each.item_id for each in verdicts.taken if each.mass == each.mass]
    assert items == [each for each in weighed if begin.item_id <= each <= end.item_id]


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
        # A client may ask for the endpoints without security, but not open a session.
        open_client = Client(url, PATIENCE, PATIENCE)
        await open_client.connect_socket()
        await open_client.send_hello()
        await open_client.open_secure_channel()
        assert len(await open_client.get_endpoints()) == 6
        mode = ua.StatusCodes.BadSecurityModeRejected
        assert await refusal(open_client.create_session()) == mode
        open_client.disconnect_socket()
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

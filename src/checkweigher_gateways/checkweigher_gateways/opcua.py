# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gateway that serves each lane by OPC UA, as a checkweigher of OPC 40200."""

from collections.abc import Iterable
from contextlib import suppress
from functools import cached_property, partial
import logging
from pathlib import Path
import socket
from typing import Any, ClassVar

from asyncua import Server, ua
from asyncua.crypto.truststore import TrustStore
from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions

from checkweigher_core.health.findings import Finding, conclude
from checkweigher_core.printable import one_line
from checkweigher_core.records import Alarms, ProductOnLine, Verdict
from checkweigher_core.ros.ports import DIAGNOSTICS
from checkweigher_gateways.gateway import Gateway, GatewayError
from checkweigher_gateways.lane_state import LaneStates
from checkweigher_gateways.listening import Taken
from checkweigher_gateways.nodesets import OWN, Namespaces, check, default_folder, load
from checkweigher_gateways.opcua_access import CALLER, Rights, Users
from checkweigher_gateways.opcua_space import LaneSpace
from checkweigher_gateways.settings import GatewaySettings, OpcuaSettings
from checkweigher_web.access.certificate import check_pair
from checkweigher_web.access.users import Role, UserFile, default_users
from checkweigher_web.work import actions
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Person, Workshop

_LOOPBACK = ('127.0.0.1', '::1', 'localhost')
_POLICIES = [
    getattr(ua.SecurityPolicyType, f'{policy}_{mode}')
    for policy in ('Basic256Sha256', 'Aes128Sha256RsaOaep', 'Aes256Sha256RsaPss')
    for mode in ('Sign', 'SignAndEncrypt')
]
# Numbers, in namespace 0, of the OPC UA methods Acknowledge, ConditionRefresh, ConditionRefresh2,
# Enable, Disable, AddComment and Confirm of conditions.
_ACKNOWLEDGE, _REFRESH = 9111, (3875, 12912)
_ENABLE, _DISABLE, _COMMENT, _CONFIRM = 9027, 9028, 9029, 9113


async def _refuse(why: str, services: LaneServices, *_: Any) -> str:
    raise ActionRefusedError(why)


_RECIPES = partial(_refuse, 'products are changed only in the recipe file')
_HOLD = partial(_refuse, 'a lane is held only by its own stop request; call Stop')
_SUSPEND = partial(_refuse, 'a lane is never suspended; without products it waits in Execute')
_COMPLETE = partial(_refuse, 'a lane has no end of production; call NewBatch or Stop')
# Action, lowest role, function and arguments of each method, by the path of its browse names.
_METHODS: dict[str, tuple[str, Role, Any, tuple[str, ...]]] = {
    'SetZero': ('zero', Role.OPERATOR, actions.zero, ()),
    'ProductionPreset.SelectProduct': (
        'select product', Role.OPERATOR, actions.select_product, ('ProductId',)),
    'ProductionPreset.SwitchProduct': (
        'select product', Role.OPERATOR, actions.select_product, ('ProductId',)),
    'ProductionPreset.DeselectProduct': (
        'deselect product', Role.OPERATOR,
        partial(_refuse, 'a lane keeps its product until another one is selected'), ('ProductId',)),
    'ProductionPreset.AddProduct': (
        'add product', Role.TECHNICIAN, _RECIPES, ('ProductName', 'ProductId', 'ProductType')),
    'ProductionPreset.RemoveProduct': (
        'remove product', Role.TECHNICIAN, _RECIPES, ('ProductId',)),
    'State.Clear': ('reset stop request', Role.OPERATOR, actions.reset_stop, ()),
    'State.Abort': ('stop weighing', Role.OPERATOR, actions.stop, ()),
    'State.MachineState.Stop': ('stop weighing', Role.OPERATOR, actions.stop, ()),
    'State.MachineState.Reset': ('reset stop request', Role.OPERATOR, actions.reset_stop, ()),
    'State.MachineState.ExecuteState.Start': ('start weighing', Role.OPERATOR, actions.start, ()),
    'State.MachineState.ExecuteState.Unhold': (
        'reset stop request', Role.OPERATOR, actions.reset_stop, ()),
    'State.MachineState.ExecuteState.Reset': (
        'reset stop request', Role.OPERATOR, actions.reset_stop, ()),
    'State.MachineState.ExecuteState.Hold': ('hold', Role.OPERATOR, _HOLD, ()),
    'State.MachineState.ExecuteState.Suspend': ('suspend', Role.OPERATOR, _SUSPEND, ()),
    'State.MachineState.ExecuteState.Unsuspend': ('unsuspend', Role.OPERATOR, _SUSPEND, ()),
    'State.MachineState.ExecuteState.ToComplete': ('complete', Role.OPERATOR, _COMPLETE, ()),
}  # fmt: skip


async def _set_limits(services: LaneServices, lower: str, upper: str) -> str:
    try:
        wanted = actions.MassLimits(float(lower), float(upper))
    except ValueError:
        raise ActionRefusedError(f'{lower!r} and {upper!r} are not masses in kg') from None
    return await actions.set_limits(services, wanted)


_OWN_METHODS: dict[str, tuple[str, Role, Any, tuple[str, ...]]] = {
    'NewBatch': ('begin batch', Role.OPERATOR, actions.new_batch, ('BatchId',)),
    'SetLimits': ('set limits', Role.TECHNICIAN, _set_limits, ('Lower', 'Upper')),
}


class OpcuaGateway(Gateway):
    """OPC UA server, which runs in the event loop of the gateway.

    After a restart, the gateway receives the latest verdicts of the line again, and fills the
    history of the masses with them.
    """

    kept: ClassVar[bool] = True

    def __init__(self, settings: OpcuaSettings) -> None:
        self._settings = settings
        self._states = LaneStates()
        self._lanes: dict[str, LaneSpace] = {}
        self._namespaces: Namespaces | None = None

    async def start(self) -> str:
        """Load the models, start the server, and return its URL.

        Raises `GatewayError` if the models, the certificate or the address cannot be used, or if
        the address is not a loopback address and there is no certificate.
        """
        # Suppress the log of asyncua, because it contains an entry for each refused client.
        logging.getLogger('asyncua').setLevel(logging.CRITICAL)
        its = self._settings
        users = UserFile(Path(its.users) if its.users else default_users())
        folder = Path(its.nodesets) if its.nodesets else default_folder()
        if its.host not in _LOOPBACK and not its.certificate:
            raise GatewayError(f'opcua: host {its.host} requires certificate, key and clients')
        self._server = server = Server(user_manager=Users(users))
        try:
            check(folder)
            await server.init()
            self._namespaces = await load(server, folder)
            await self._secure()
            server.set_endpoint(f'opc.tcp://{its.host}:{its.port}/checkweigher')
            await server.start()
        except (OSError, ValueError) as error:
            raise GatewayError(f'opcua: {one_line(error)}') from None
        methods = {
            _ACKNOWLEDGE: self._acknowledge,
            **dict.fromkeys(_REFRESH, self._refresh),
            **dict.fromkeys((_ENABLE, _DISABLE, _COMMENT, _CONFIRM), self._refuse),
        }
        for number, method in methods.items():
            server.link_method(server.get_node(ua.NodeId(number)), method)
        assert server.bserver is not None
        return f'opc.tcp://{its.host}:{server.bserver.port}/checkweigher'

    async def _secure(self) -> None:
        its, server = self._settings, self._server
        await server.set_application_uri(f'{OWN}:{socket.gethostname()}')
        server.set_server_name('Checkweigher')
        policies = [ua.SecurityPolicyType.NoSecurity]
        if its.certificate:
            check_pair(Path(its.certificate), Path(its.key))
            await server.load_certificate(its.certificate, 'pem')
            await server.load_private_key(its.key, format='pem')
            store = TrustStore([Path(its.clients)], [])
            await store.load()
            known = CertificateValidatorOptions
            server.set_certificate_validator(
                CertificateValidator(
                    known.TIME_RANGE | known.URI | known.TRUSTED | known.PEER_CLIENT, store
                ).validate
            )
            policies = _POLICIES
        server.set_security_policy(policies, permission_ruleset=Rights())
        anonymous = [ua.AnonymousIdentityToken] if its.host in _LOOPBACK else []
        server.set_identity_tokens([*anonymous, ua.UserNameIdentityToken])

    async def take(self, taken: Taken) -> None:
        """Update the nodes of a lane with a record.

        Diagnostics and other records of the state are shown by the next call of `turn`.
        """
        self._states.take(taken)
        if taken.port is DIAGNOSTICS:
            return
        space = self._lanes.get(taken.lane) or await self._add(taken.lane)
        if isinstance(taken.record, Verdict):
            await space.show_item(taken.record)
        elif isinstance(taken.record, Alarms):
            await space.show_alarms(taken.record.alarms)
        elif isinstance(taken.record, ProductOnLine):
            await self._show_products(taken.lane)

    async def turn(self) -> None:
        """Update the nodes that show the state of each lane."""
        for space in self._lanes.values():
            await space.update()

    async def _add(self, lane: str) -> LaneSpace:
        assert self._namespaces is not None
        space = LaneSpace(self._server, self._namespaces, self._states.of(lane))
        await space.build()
        for own, methods in ((False, _METHODS), (True, _OWN_METHODS)):
            for path, (what, role, action, arguments) in methods.items():
                packml = self._namespaces.packml if path.startswith('State.') else None
                index = self._namespaces.own if own else packml

                async def call(
                    _: Any,
                    *values: ua.Variant,
                    what: str = what,
                    role: Role = role,
                    action: Any = action,
                ) -> Any:
                    return await self._act(lane, what, role, action, *values)

                await space.add_method(path, call, *arguments, space=index)
        self._lanes[lane] = space
        return space

    @cached_property
    def _workshop(self) -> Workshop:
        return Workshop(self.intake.spinner, 'gateway_opcua_work')

    async def _show_products(self, lane: str) -> None:
        # `ActionRefusedError` is raised if the lane has no valid recipe file, or if its node
        # `product` does not answer.
        with suppress(ActionRefusedError):
            products = await actions.products(await self._workshop.of(lane))
            await self._lanes[lane].show_products(products)

    async def _act(
        self, lane: str, what: str, role: Role, action: Any, *values: ua.Variant
    ) -> ua.StatusCode:
        """Perform an action for the caller of a method, and send its outcome as an event.

        The status is Good, or BadInvalidState if the action has failed. If the role of the caller
        is below `role`, no event is sent, and the status is BadUserAccessDenied.
        """
        caller = CALLER.get()
        if caller is None or caller.rank < role:
            return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
        given = [str(each.Value) for each in values]
        services = await self._workshop.of(lane)
        outcome = await services.act(
            Person(str(caller.name), 'OPC UA'),
            one_line(' '.join((what, *given))),
            '',
            partial(action, services, *given),
        )
        await self._lanes[lane].say(f'{what}: {outcome.text}')
        good = ua.StatusCodes.Good if outcome.done else ua.StatusCodes.BadInvalidState
        return ua.StatusCode(good)

    async def _acknowledge(self, condition: ua.NodeId, *_: ua.Variant) -> ua.StatusCode:
        """Acknowledge all alarms of the lane to which a condition belongs.

        Returns the status of `_act`, or BadNodeIdUnknown if the condition belongs to no lane.
        """
        named = str(condition.Identifier)
        for lane, space in self._lanes.items():
            if named.startswith(f'{space.name}.Alarms '):
                action = actions.acknowledge_alarms
                return await self._act(lane, 'acknowledge alarms', Role.OPERATOR, action)
        return ua.StatusCode(ua.StatusCodes.BadNodeIdUnknown)

    async def _refresh(self, *_: Any) -> ua.StatusCode:
        for space in self._lanes.values():
            await space.refresh()
        return ua.StatusCode(ua.StatusCodes.Good)

    async def _refuse(self, *_: Any) -> ua.StatusCode:
        return ua.StatusCode(ua.StatusCodes.BadNotSupported)

    def findings(self, now: float) -> Iterable[Finding]:
        """Yield the finding with the number of served lanes."""
        yield conclude('Server', f'{len(self._lanes)} lanes are served')

    async def close(self) -> None:
        """Stop the server."""
        await self._server.stop()


def make(settings: GatewaySettings) -> Gateway:
    """Return the OPC UA gateway."""
    return OpcuaGateway(settings.opcua or OpcuaSettings())

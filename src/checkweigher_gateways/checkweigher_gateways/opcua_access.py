# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Users and roles of the OPC UA server, which are the users and roles of the page."""

import asyncio
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.server import binary_server_asyncio
from asyncua.server.uaprocessor import UaProcessor
from asyncua.server.user_managers import UserManager
from asyncua.ua.ua_binary import struct_from_binary

from checkweigher_web.access.throttle import Throttle
from checkweigher_web.access.users import NOBODY, Role, UserFile, account_name


@dataclass
class Caller(User):
    """User of the server, with the role that the user has on the page."""

    rank: Role = Role.VIEWER


# User who sent the request that the current asyncio task handles, or None without such a user.
CALLER: ContextVar[Caller | None] = ContextVar('caller', default=None)
# User whose password the current asyncio task has found valid, or None without such a user.
_CHECKED: ContextVar[Caller | None] = ContextVar('checked', default=None)

_CREATE, _ACTIVATE = (
    ua.NodeId(getattr(ua.ObjectIds, f'{name}SessionRequest_Encoding_DefaultBinary'))
    for name in ('Create', 'Activate')
)


class Users(UserManager):
    """User manager with the users file of the page. A client without a user name may only read.

    asyncua admits a client without a user name only if the server offers anonymous logins.
    """

    def __init__(self, users: UserFile) -> None:
        self._users = users
        self._throttle = Throttle()
        # Lock for the check of a password, so that a login cannot start before the throttle has
        # counted the previous failed login.
        self._turn = asyncio.Lock()

    async def check(self, username: str, password: str) -> Caller | None:
        """Return the user, or None if the login is wrong or comes too soon after failed logins.

        The password is checked in a thread, because the check takes about 0.1 s.
        """
        name = account_name(username)
        key = f'account {name}'
        async with self._turn:
            user = self._users.find(name) or NOBODY
            if self._throttle.wait(key) or not await asyncio.to_thread(user.has_password, password):
                self._throttle.fail(key)
                return None
            self._throttle.forget(key)
            return Caller(UserRole.User, user.name, user.role)

    def get_user(
        self,
        iserver: Any,
        username: str | None = None,
        password: Any = None,
        certificate: Any = None,
    ) -> User | None:
        """Return the user whose password was checked, or an anonymous user if there is no name.

        Returns None, which refuses the session, if the password was not valid.
        """
        if username is None:
            return Caller(UserRole.User, 'anonymous')
        return _CHECKED.get()


class _Processor(UaProcessor):
    """Processor of the requests of a client.

    asyncua lets each client open a channel without security, to ask for the endpoints. This class
    refuses sessions in a channel without security, unless the server has an endpoint without
    security.
    """

    async def _process_message(self, typeid: Any, header: Any, sequence: Any, body: Any) -> Any:
        if typeid == _CREATE and self._connection.security_policy.permissions is None:
            raise ServiceError(ua.StatusCodes.BadSecurityModeRejected)
        if typeid == _ACTIVATE:
            _CHECKED.set(await self._check(header, body.copy()))
        return await super()._process_message(typeid, header, sequence, body)

    async def _check(self, header: Any, body: Any) -> Caller | None:
        """Return the user who activates a session.

        Returns None if the session is unknown, if the request has no user name, or if `Users.check`
        refuses the login.
        """
        token = struct_from_binary(ua.ActivateSessionParameters, body).UserIdentityToken
        session = self.session or self.iserver.lookup_external_session(header.AuthenticationToken)
        if session is None or not isinstance(token, ua.UserNameIdentityToken):
            return None
        # Ignore an invalid token here, because asyncua itself refuses it.
        with suppress(Exception):
            name, password = self.iserver.decrypt_user_token(session, token)
            return await self.iserver.user_manager.check(name, password)
        return None


# Replace the class in the module of asyncua, because there is no other way to choose the class that
# processes requests.
binary_server_asyncio.UaProcessor = _Processor


class Rights(SimpleRoleRuleset):
    """Rights of all users to read, browse, subscribe and call methods.

    Each method itself checks the role of its caller.
    """

    def check_validity(self, user: Any, action_type_id: Any, body: Any) -> bool:
        """Return whether a user may send a request, and store the user in `CALLER`.

        A method that the request calls reads the user from `CALLER`.
        """
        CALLER.set(user if isinstance(user, Caller) else None)
        return bool(super().check_validity(user, action_type_id, body))

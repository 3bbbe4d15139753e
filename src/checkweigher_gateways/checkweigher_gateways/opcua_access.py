# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Users and roles of the OPC UA server, which it shares with the page."""

from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.server.user_managers import UserManager

from checkweigher_web.access.throttle import Throttle
from checkweigher_web.access.users import NOBODY, Role, UserFile, account_name


@dataclass
class Caller(User):
    """User of the server, with the role that the user has on the page."""

    rank: Role = Role.VIEWER


# User whose request the running task processes.
CALLER: ContextVar[Caller | None] = ContextVar('caller', default=None)


class Users(UserManager):
    """Logins with the users file of the page. A client without a user name may only read.

    asyncua admits such a client only if the server offers anonymous logins.
    """

    def __init__(self, users: UserFile) -> None:
        self._users = users
        self._throttle = Throttle()

    def get_user(
        self,
        iserver: Any,
        username: str | None = None,
        password: Any = None,
        certificate: Any = None,
    ) -> User | None:
        """Return the user, or None if the login is wrong or comes too soon after failures."""
        if username is None:
            return Caller(UserRole.User, 'anonymous')
        name = account_name(username)
        key = f'account {name}'
        text = password.decode(errors='replace') if isinstance(password, bytes) else password
        user = self._users.find(name) or NOBODY
        if self._throttle.wait(key) or not user.has_password(text or ''):
            self._throttle.fail(key)
            return None
        self._throttle.forget(key)
        return Caller(UserRole.User, user.name, user.role)


class Rights(SimpleRoleRuleset):
    """Rights of all users to read, browse, subscribe and call. The methods check the role."""

    def check_validity(self, user: Any, action_type_id: Any, body: Any) -> bool:
        """Return whether a user may send a request, and store the user for its methods."""
        CALLER.set(user if isinstance(user, Caller) else None)
        return bool(super().check_validity(user, action_type_id, body))

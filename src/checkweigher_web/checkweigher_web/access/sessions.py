# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sessions of the users who have logged in."""

from collections.abc import Callable
from dataclasses import dataclass
import secrets
import time

from checkweigher_web.access.users import Role, User, UserFile

ABSOLUTE = 12 * 3600.0  # maximum duration of a session in s


@dataclass
class Session:
    """Session of a user, who has logged in from the network address `address`.

    `user` is the entry of the user in the users file at the time of the login. A logout form must
    contain `token`.
    """

    user: User
    address: str
    token: str
    began: float  # time of the login in s
    used: float  # time of the latest use of the session in s


class Sessions:
    """Sessions of users, by random identifiers.

    A session ends at a logout, after `idle` s without use, `ABSOLUTE` s after the login, or when
    its user is removed or gets another role or password. `clock` returns the time in s.
    """

    def __init__(
        self, users: UserFile, idle: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._users = users
        self._idle = idle
        self._clock = clock
        self._sessions: dict[str, Session] = {}

    def begin(self, user: User, address: str) -> str:
        """Begin a session, and return its new identifier."""
        identifier, now = secrets.token_urlsafe(32), self._clock()
        self._sessions[identifier] = Session(user, address, secrets.token_urlsafe(32), now, now)
        return identifier

    def find(self, identifier: str, *, used: bool = False) -> Session | None:
        """Return the session with an identifier, or None if it has ended or never existed.

        If `used` is true, the call counts as use of the session.
        """
        session, now = self._sessions.get(identifier), self._clock()
        if session is None:
            return None
        late = now - session.used > self._idle or now - session.began > ABSOLUTE
        if late or _rights(self._users.find(session.user.name)) != _rights(session.user):
            self.end(identifier)
            return None
        if used:
            session.used = now
        return session

    def end(self, identifier: str) -> None:
        """End a session if it exists."""
        self._sessions.pop(identifier, None)


def _rights(user: User | None) -> tuple[Role, str] | None:
    """Return the role and the password hash of a user, or None if `user` is None.

    A change of the role or the hash ends the sessions of the user. The keys of the user are left
    out, because the first signature adds a key and must not end the session.
    """
    return (user.role, user.hash) if user else None

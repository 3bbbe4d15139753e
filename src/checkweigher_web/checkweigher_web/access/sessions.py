# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sessions: who has logged in, until they log out, are away too long, or the shift is over."""

from collections.abc import Callable
from dataclasses import dataclass
import secrets
import time

from checkweigher_web.access.users import User, UserFile

ABSOLUTE = 12 * 3600.0  # s, a long shift


@dataclass
class Session:
    """One login of a user; `token` has to come with the forms of its pages."""

    user: User
    address: str
    token: str
    began: float  # s
    used: float  # s


class Sessions:
    """The logins that hold, by identifiers that nobody can guess.

    One ends after `idle` s without use, or with the shift; `clock` is in s.
    """

    def __init__(
        self, users: UserFile, idle: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._users = users
        self._idle = idle
        self._clock = clock
        self._sessions: dict[str, Session] = {}

    def begin(self, user: User, address: str) -> str:
        """Return the new identifier of a login; one that a browser had before is never taken."""
        identifier, now = secrets.token_urlsafe(32), self._clock()
        self._sessions[identifier] = Session(user, address, secrets.token_urlsafe(32), now, now)
        return identifier

    def find(self, identifier: str, *, used: bool = False) -> Session | None:
        """Return the session that an identifier has, None if it has none or it has ended.

        It ends with the user: one who was removed, or whose role or password was changed, has to
        log in again. `used` tells that the person did something.
        """
        session, now = self._sessions.get(identifier), self._clock()
        if session is None:
            return None
        late = now - session.used > self._idle or now - session.began > ABSOLUTE
        if late or self._users.find(session.user.name) != session.user:
            self.end(identifier)
            return None
        if used:
            session.used = now
        return session

    def end(self, identifier: str) -> None:
        """End a session."""
        self._sessions.pop(identifier, None)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sessions, which end by logout, after some time without use, or after a long shift."""

from collections.abc import Callable
from dataclasses import dataclass
import secrets
import time

from checkweigher_web.access.users import User, UserFile

ABSOLUTE = 12 * 3600.0  # s; a long shift


@dataclass
class Session:
    """One login of a user; the forms of its pages must contain `token`."""

    user: User
    address: str
    token: str
    began: float  # s
    used: float  # s


class Sessions:
    """Sessions by identifiers that nobody can guess.

    A session ends after `idle` s without use, at the latest after `ABSOLUTE` s. `clock` is in s.
    """

    def __init__(
        self, users: UserFile, idle: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._users = users
        self._idle = idle
        self._clock = clock
        self._sessions: dict[str, Session] = {}

    def begin(self, user: User, address: str) -> str:
        """Begin a session and return its identifier, which is always a new one."""
        identifier, now = secrets.token_urlsafe(32), self._clock()
        self._sessions[identifier] = Session(user, address, secrets.token_urlsafe(32), now, now)
        return identifier

    def find(self, identifier: str, *, used: bool = False) -> Session | None:
        """Return the session of an identifier, or None if there is none or it has ended.

        A session also ends if the user is removed, or the role or password changes. With
        `used`, the call counts as use of the session.
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

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Ends of sessions, and their identifiers, which never come from a browser."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from checkweigher_web.access.sessions import ABSOLUTE, Sessions
from checkweigher_web.access.users import Role, User, UserFile, write_users

ANNA = User('anna', Role.OPERATOR, '$argon2id$x')
IDLE = 600.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_users(tmp_path / 'users', {'anna': ANNA})
    return tmp_path / 'users'


def test_a_session_ends_when_it_is_not_used_and_with_the_shift(path: Path):
    clock = SimpleNamespace(now=1000.0)
    sessions = Sessions(UserFile(path), IDLE, lambda: clock.now)
    idle = sessions.begin(ANNA, 'here')
    clock.now += IDLE - 1
    assert sessions.find(idle) is not None  # `find` does not use the session
    clock.now += 2
    assert sessions.find(idle, used=True) is None

    used, began = sessions.begin(ANNA, 'here'), clock.now
    while clock.now < began + ABSOLUTE:
        assert sessions.find(used, used=True) is not None
        clock.now += IDLE / 2
    clock.now += 1
    assert sessions.find(used, used=True) is None


@pytest.mark.parametrize(
    'users', [{}, {'anna': User('anna', Role.VIEWER, ANNA.hash)},
              {'anna': User('anna', Role.OPERATOR, '$argon2id$new')}]
)  # fmt: skip
def test_a_session_ends_with_its_user(users: dict[str, User], path: Path):
    sessions = Sessions(UserFile(path), IDLE)
    identifier = sessions.begin(ANNA, 'here')
    assert sessions.find(identifier) is not None
    write_users(path, users)
    assert sessions.find(identifier) is None

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Desk of a user, whose role is checked again before each action."""

import asyncio
from dataclasses import replace
from pathlib import Path
import re

from nicegui import Client, ui
import pytest
from starlette.requests import Request

from checkweigher_web.access.guard import Access
from checkweigher_web.access.site import Site
from checkweigher_web.access.users import Role, User, hash_password, read_users, write_users
from checkweigher_web.lane import Lane
from checkweigher_web.languages.language import ENGLISH
from checkweigher_web.work.audit_view import Auditor
from checkweigher_web.work.dialogs import Desk, field, number_in
from checkweigher_web.work.services import ActionRefusedError, LaneServices

ANNA = User('anna', Role.OPERATOR, hash_password('anna', 'correct horse'))


async def nobody() -> LaneServices:
    raise AssertionError('the services of the lane were asked for')


async def nothing() -> str:
    raise AssertionError('it was done')


@pytest.mark.parametrize(
    ('text', 'understood'),
    [
        ('150', 150.0),
        (' 0,150 ', 0.15),
        ('1,5', 1.5),
        ('1000,250', 1000.25),
        ('-.5', -0.5),
        ('', 7.0),
        ('1,000', '1,000 may be 1.000 or 1000: write one of these'),
        ('1,000,000', "'1,000,000' is not a number"),
        ('1_000', "'1_000' is not a number"),
        ('nan', "'nan' is not a number"),
        ('1:30', "'1:30' is not a number"),
    ],
)
def test_a_number_is_understood_in_one_way_or_refused(text: str, understood: float | str):
    with Client(ui.page('/')):
        given = field('Mass', text, 'g')
    if isinstance(understood, float):
        assert number_in(given, ENGLISH, empty=7.0) == understood
    else:
        with pytest.raises(ActionRefusedError, match=f'^Mass: {re.escape(understood)}$'):
            number_in(given, ENGLISH)


@pytest.mark.parametrize('needed', [Role.OPERATOR, Role.TECHNICIAN])
def test_a_role_that_somebody_lacks_when_it_acts_is_refused(needed: Role, tmp_path: Path):
    users = tmp_path / 'users'
    write_users(users, {'anna': ANNA})
    access = Access(Site(users=users))
    identifier = access.sessions.begin(ANNA, '127.0.0.1')
    scope = {'type': 'http', 'path': '/', 'headers': [], 'checkweigher.session': identifier}

    async def act() -> None:
        with Client(ui.page('/'), request=Request(scope)):
            desk = Desk(access, Lane('a'), nobody, Auditor(), ENGLISH)
        assert desk.role == Role.OPERATOR
        if needed == Role.OPERATOR:  # the user loses the role while the dialog is open
            known = read_users(users)
            write_users(users, {'anna': replace(known['anna'], role=Role.VIEWER)})
        outcome = await desk.perform(needed, 'zero', nothing, '')
        assert not outcome.done
        assert outcome.text == f'this needs a login as {needed.name.lower()}'

    asyncio.run(act())

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The header of each page, with the lane, the user, login and logout."""

from collections.abc import Callable

from nicegui import ui

from checkweigher_web.access.guard import LOGIN, Access
from checkweigher_web.access.login import logout_form
from checkweigher_web.elements import Pulse

_PERIOD = 1.0  # s
_HOW_TO_ACT = (
    'This page only shows, for it has no users. To work on the machine by it, run in a terminal: '
    './checkweigher user add NAME --role technician'
)


def header(
    access: Access,
    lane: str,
    others: Callable[[], bool] = lambda: False,
    silence: Callable[[], float] = lambda: 0.0,
) -> None:
    """Show the header of the page of a lane.

    `others` returns whether there are other lanes, which the header links to. `silence` returns the
    time in s since the last diagnostics of the lane. The browser greys the page while the lane is
    silent or the server does not answer.
    """
    session = access.session_of(ui.context.client)
    with ui.element('header').classes('head'):
        ui.label(f'lane {lane}' if lane else 'Checkweigher').classes('title')
        link = ui.link('All lanes', '/')
        link.set_visibility(others())
        if session is not None:
            ui.label(f'{session.user.name}, {session.user.role.name.lower()}')
            ui.html(logout_form(session.token), sanitize=False)
        else:
            ui.link('Log in', LOGIN)
    pulse = Pulse()

    def update() -> None:
        link.set_visibility(others())
        pulse.beat(silence())

    ui.timer(_PERIOD, update)


def hint_to_users(access: Access) -> None:
    """Show how to add a user if the page has no users."""
    if not access.users.now():
        ui.label(_HOW_TO_ACT).classes('hint')

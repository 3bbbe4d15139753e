# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The head of each page: the lane, who has logged in, and the way in and out."""

from nicegui import ui

from checkweigher_web.access.guard import LOGIN, Access
from checkweigher_web.access.login import logout_form


def header(access: Access, lane: str) -> None:
    """Show the head of a page of a lane."""
    session = access.session_of(ui.context.client)
    with ui.element('header').classes('head'):
        ui.label(f'lane {lane}' if lane else 'Checkweigher').classes('title')
        if session is not None:
            ui.label(f'{session.user.name}, {session.user.role.name.lower()}')
            ui.html(logout_form(session.token), sanitize=False)
        elif access.sessions is not None:
            ui.link('Log in', LOGIN)

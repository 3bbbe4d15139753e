# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Header of each page, with the state of the lane, the user, the clock and the menu."""

from collections.abc import Callable, Sequence
from copy import copy
from datetime import datetime
from functools import partial

from nicegui import ui

from checkweigher_core.health.findings import Level
from checkweigher_core.ros.status_board import Row
from checkweigher_web.access.guard import LOGIN, Access
from checkweigher_web.access.login import logout_form
from checkweigher_web.elements import Pulse, heading, menu_entry
from checkweigher_web.languages.language import (
    LANGUAGE,
    NAMES,
    UNIT,
    UNITS,
    Language,
    Text,
    language_of,
    own_name,
)
from checkweigher_web.views.item import silence, standstill
from checkweigher_web.views.view import Look
from checkweigher_web.work.dialogs import Dialog

_PERIOD = 1.0  # s
_LEVELS = Level.ERROR, Level.WARN
_FACTS = 'product', 'batch', 'state', 'alarms', 'health'
_HOW_TO_ACT = Text(
    'This page is read-only, because it has no users yet. To operate the machine, press "Log in": '
    'the terminal in which the page was started then shows a code.'
)


def header(
    access: Access,
    title: str,
    say: Language,
    look: Look | None = None,
    others: Callable[[], bool] = lambda: False,
    work: Callable[[], object] = lambda: None,
    back: tuple[str, str] = (Text('All lanes'), '/'),
) -> None:
    """Show the header of a page with its title, the state of its lane and a menu.

    `say` is the language of the viewer. `look` is the state of the viewer of a running lane, or
    None on other pages. `back` contains the English text and the address of a link, which the
    header shows while `others` returns true. `work` adds entries to the menu. The browser greys the
    page while the lane is silent or the server does not answer.
    """
    session = access.session_of(ui.context.client)
    with ui.element('header').classes('head'):
        pulse = Pulse(say)
        heading(title)
        facts = None if look is None else _Facts(look)
        link = ui.link(say(back[0]), back[1])
        link.set_visibility(others())
        if session is not None:
            ui.label(f'{session.user.name}, {say(session.user.role.name.lower())}')
            ui.html(logout_form(session.token, say), sanitize=False)
        else:
            ui.link(say('Log in'), LOGIN)
        time_of_line = ui.label('').classes('clock')
        with ui.button(say('Menu')).props('outline aria-haspopup=menu'), ui.menu():
            work()
            menu_entry(say('Dark or light'), lambda: pulse.run_method('theme'))
            menu_entry(say('Full screen'), lambda: pulse.run_method('full'))
            menu_entry(say('Language and unit'), partial(_choose_language, say))

    def update() -> None:
        link.set_visibility(others())
        time_of_line.set_text(f'{datetime.now().astimezone():%H:%M:%S %Z}')
        if facts is not None:
            facts.show()
        pulse.beat(0.0 if facts is None else facts.silence, '' if facts is None else facts.wakes)

    update()
    ui.timer(_PERIOD, update)


def page_language() -> Language:
    """Return the language and unit of the viewer, and set the language and title of the page."""
    client = ui.context.client
    say = language_of(client.request.headers, client.request.cookies)
    # Copy the page object of NiceGUI, because viewers of other languages share the object.
    client.page = copy(client.page)
    client.page.language = say.tag  # type: ignore[assignment]
    ui.page_title(say('Checkweigher'))
    return say


def _choose_language(say: Language) -> None:
    """Open a dialog for the language and the unit of mass, which the browser stores in cookies."""

    def choice(label: str, cookie: str, known: dict[str, str], now: str) -> None:
        chosen = ui.select(known, label=label, value=now).props('outlined dense')
        chosen.on_value_change(
            lambda: ui.run_javascript(
                f'document.cookie = "{cookie}={chosen.value}; path=/; max-age=31536000; '
                'samesite=strict"; location.reload()'
            )
        )

    with Dialog(Text('Language and unit'), say).body:
        choice(say('Language'), LANGUAGE, {name: own_name(name) for name in NAMES}, say.name)
        choice(say('Unit of mass'), UNIT, {unit: unit for unit in UNITS}, say.unit)


class _Facts:
    """State of a lane in the header: product, batch, whether it weighs, alarms, diagnostics."""

    silence = 0.0  # longest silence in s of the nodes that weigh, or 0 if none of them is silent
    wakes = ''  # text whose changes wake a dimmed screen

    def __init__(self, look: Look) -> None:
        self._look = look
        self._labels = {name: ui.label('').classes(f'fact {name}') for name in _FACTS}

    def show(self) -> None:
        """Update the header to the present state of the lane."""
        lane, nodes, say = self._look.drawing.lane, self._look.nodes(), self._look.say
        waiting = sum(not each.acknowledged_by for each in lane.alarms)
        stop = '' if lane.stop is None else f'STOP {lane.stop.reason}'
        known, still = lane.statistics, standstill(nodes)
        product, batch = (known.product, known.batch) if known else ('', '')
        self._set('product', product or say('no product'))
        self._set('batch', say('batch {name}', name=batch) if batch else say('no batch'))
        self._set('state', stop or say(still) or say('running'), _level(stop, still))
        alarms = say.plural('{count} alarm', '{count} alarms', waiting)
        self._set('alarms', alarms if waiting else say('no alarms'), _level('', waiting))
        self._show_health(nodes)
        self.silence = silence(nodes)
        self.wakes = f'{lane.version} {waiting} {stop}'

    def _show_health(self, nodes: Sequence[Row]) -> None:
        errors, warnings = (sum(row.level == level for row in nodes) for level in _LEVELS)
        say = self._look.say
        told = ''
        if errors:
            told = say.plural('{count} error', '{count} errors', errors)
        elif warnings:
            told = say.plural('{count} warning', '{count} warnings', warnings)
        self._set('health', told, _level(errors, warnings))

    def _set(self, name: str, text: str, level: str = '') -> None:
        label = self._labels[name]
        label.set_text(text)
        label.classes(replace=f'fact {name} {level}')


def _level(error: object, warning: object) -> str:
    return 'level-ERROR' if error else 'level-WARN' if warning else ''


def hint_to_users(access: Access, say: Language) -> None:
    """Show how to add the first user if the page has no users."""
    if not access.users.now():
        with ui.element('aside').classes('hint'):
            ui.label(say(_HOW_TO_ACT))

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog of a simulated machine, with its feed, belt speed, product mass and load."""

from functools import partial

from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_web.access.users import Role
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Action, Desk, ask, field, number_in
from checkweigher_web.work.services import LaneServices

_TEXT = (
    'To try the work on a machine without one: stop the feed to zero and calibrate, put masses on '
    'the belt, let products of one mass pass at several speeds. It holds within two seconds.'
)


async def operate(desk: Desk, services: LaneServices) -> None:
    """Open a dialog with the settings of the simulated machine."""
    now = await actions.operation(services)

    def value(label: str, given: float, unit: str) -> ui.input:
        return field(label, f'{given:g}' if given else '', unit)

    def plan(
        feed: ui.checkbox, speed: ui.input, mass: ui.input, load: ui.input
    ) -> tuple[str, Action]:
        wanted = {
            'feed': bool(feed.value),
            'speed': number_in(speed, desk.say, empty=0.0) / 60,
            'mass': number_in(mass, desk.say, empty=0.0) / GRAMS,
            'load': number_in(load, desk.say, empty=0.0) / GRAMS,
        }
        what = ', '.join(f'{name} {value:g}' for name, value in wanted.items())
        return f'simulated machine: {what}', partial(actions.operate, services, wanted)

    ask(
        desk,
        'Simulated machine',
        _TEXT,
        'Set',
        plan,
        partial(ui.checkbox, 'Feed: products come', value=now.feed),
        partial(value, 'Belt speed (empty: as configured)', 60 * now.speed, 'm/min'),
        partial(value, 'Mass of each product (empty: as configured)', GRAMS * now.mass, 'g'),
        partial(value, 'Mass that stands on the belt', GRAMS * now.load, 'g'),
        role=Role.TECHNICIAN,
    )

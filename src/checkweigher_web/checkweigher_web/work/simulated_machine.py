# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The switches of a simulated machine, and the hands that put a mass on its belt."""

from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_web.access.users import Role
from checkweigher_web.work import actions
from checkweigher_web.work.actions import Operation
from checkweigher_web.work.dialogs import Action, Desk, ask, field, number
from checkweigher_web.work.services import LaneServices

_TEXT = (
    'To try the work on a machine without one: stop the feed to zero and calibrate, put masses on '
    'the belt, let products of one mass pass at several speeds. It holds within two seconds.'
)


async def operate(desk: Desk, services: LaneServices) -> None:
    """Ask what is to be set at the machine."""
    now = await actions.operation(services)
    given: dict[str, ui.input] = {}
    feed: list[ui.checkbox] = []

    def plan() -> tuple[str, Action]:
        wanted = Operation(
            bool(feed[0].value), number(given['speed'], empty=0) / 60,
            number(given['mass'], empty=0) / GRAMS, number(given['load'], empty=0) / GRAMS,
        )  # fmt: skip
        return f'simulated machine: {wanted}', lambda: actions.operate(services, wanted)

    def fields() -> None:
        feed.append(ui.checkbox('Feed: products come', value=now.feed))
        for name, label, value, unit in (
            ('speed', 'Belt speed (empty: as configured)', 60 * now.speed, 'm/min'),
            ('mass', 'Mass of each product (empty: as configured)', GRAMS * now.mass, 'g'),
            ('load', 'Mass that stands on the belt', GRAMS * now.load, 'g'),
        ):
            given[name] = field(label, f'{value:g}' if value else '', unit)

    ask(desk, Role.TECHNICIAN, 'Simulated machine', _TEXT, 'Set', plan, fields)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Practice view, which is shown only for a simulated machine and changes its settings."""

import asyncio
from dataclasses import replace

from lines import simulated
from nicegui import Client, core, ui
import pytest
from shown_lanes import lane_of

from checkweigher_core.ros.status_board import StatusBoard
from checkweigher_recording.simulation.operation import OperationParameters
from checkweigher_web.drawing import Drawing
from checkweigher_web.technician.practice import PracticeView, picture
from checkweigher_web.views.view import Look
from checkweigher_web.work.services import Outcome

RECORDING = simulated(count=2, seed=5)


class Machine:
    """Access to a simulated machine with `settings`, or to a real machine without them."""

    def __init__(self, settings: OperationParameters | None) -> None:
        self.settings = settings
        self.changes: list[dict[str, object]] = []

    async def now(self) -> OperationParameters | None:
        return self.settings

    async def set(self, **values: object) -> Outcome:
        self.changes.append(values)
        self.settings = replace(self.settings, **values)
        return Outcome(True, 'it does so')


def shown(machine: Machine | None, act=None) -> bool:
    """Show the view, act on it, and return whether it is visible."""

    async def show() -> bool:
        core.loop = asyncio.get_running_loop()
        with Client(ui.page('/')) as client:
            look = Look(Drawing(lane_of(RECORDING)), StatusBoard(), practice=machine)
            view = PracticeView(look)
            view.update()
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            if act is not None:
                await act(view)
            seen = view._machine.visible
        client.delete()
        return seen

    try:
        return asyncio.run(show())
    finally:
        core.loop = None


@pytest.mark.parametrize(
    ('machine', 'seen'),
    [(Machine(OperationParameters()), True), (Machine(None), False), (None, False)],
    ids=['simulated', 'a bag of a simulated machine', 'a viewer'],
)
def test_the_view_is_seen_by_a_technician_of_a_simulated_machine(machine, seen: bool):
    assert shown(machine) is seen


def test_a_change_sets_what_it_changes_and_no_more():
    machine = Machine(OperationParameters(put=3, load=0.2))

    async def act(view: PracticeView) -> None:
        await view._change(feed=True, infeed_dirty=True)
        view._numbers['gap'].value = '50'
        await view._set_number('gap', 1000)
        await view._put()
        await view._restore()

    shown(machine, act)
    first, *_, last = machine.changes
    assert first == {'infeed_dirty': True}
    assert {'gap': 0.05} in machine.changes
    assert {'put': 4} in machine.changes
    assert last == {'infeed_dirty': False, 'gap': 0.0, 'load': 0.0}
    assert machine.settings == OperationParameters(put=4)


def test_a_change_leaves_the_other_fields_as_they_were_typed():
    machine = Machine(OperationParameters(speed=2.5))

    async def act(view: PracticeView) -> None:
        view._numbers['speed'].value = ''  # not sent yet
        await view._change(mass=0.1)
        assert view._numbers['speed'].value == ''
        await view._set_number('speed', 60)

    shown(machine, act)
    assert machine.settings == OperationParameters(mass=0.1)
    assert machine.changes == [{'mass': 0.1}, {'speed': 0.0}]


def test_the_picture_says_what_was_done_to_the_line():
    now = OperationParameters(
        feed=False, load=0.005, zero=-0.02, infeed_dirty=True, outfeed_place=0.03
    )
    text = picture(now)
    for told in ('>dirty<', '>+30 mm<', '>5 g on the belt<', '>zero off by -20 g<'):
        assert told in text
    assert 'class="product"' not in text
    assert 'cable off' in picture(OperationParameters(infeed_dead=True))

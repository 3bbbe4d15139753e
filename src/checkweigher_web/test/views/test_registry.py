# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""All views of a lane and of a recorded shift, with and without items."""

import asyncio

from lines import simulated
from nicegui import Client, ui
import pytest
from shown_lanes import lane_of

from checkweigher_core.ros.status_board import StatusBoard
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.lane import Lane
from checkweigher_web.shift import Shift
from checkweigher_web.views.registry import VIEWS
from checkweigher_web.views.view import Look, View

RECORDING = simulated(count=12, seed=5)


def shift() -> Shift:
    found = Shift(RECORDING, LineParameters(), 'a')
    found.index()
    return found


LOOKS = {
    'a new lane': lambda: Look(Drawing(Lane('a')), StatusBoard()),
    'a lane': lambda: Look(Drawing(lane_of(RECORDING)), StatusBoard()),
    'a shift': lambda: Look(Drawing(shift())),
}


@pytest.mark.parametrize('kind', VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize('name', LOOKS)
def test_a_view_shows_what_there_is_and_what_was_chosen(kind: type[View], name: str):
    look = LOOKS[name]()

    async def show() -> None:
        with Client(ui.page('/')) as client:
            view = kind(look)
            view.update()
            for item in look.drawing.items()[-1:]:
                look.choose(row_key(item))
                look.only_faults = True
                view.update()
        client.delete()

    if kind.live if look.board is not None else kind.recorded:
        asyncio.run(show())

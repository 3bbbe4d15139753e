# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of a lane, which are drawn once for all viewers."""

from dataclasses import replace
import json
import math
from typing import Any

from lines import edges_of, simulated
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import Recording
from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    Alarm,
    Alarms,
    Decision,
    Verdict,
    ZeroChange,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_web.charts import local_times, stamp_of
from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.lane import BeltNoise, Deed, Lane, ShownItem, Span
from checkweigher_web.views.control_charts import MeansView, SpreadsView
from checkweigher_web.views.hour import hour
from checkweigher_web.views.item_list import rows_of
from checkweigher_web.views.masses import MassesView
from checkweigher_web.views.signal import drawn
from checkweigher_web.views.view import FigureView, Look


def judged(number: int, decision: Decision) -> Verdict:
    stamp = number * 1_000_000_000
    return Verdict(number, stamp + 1, decision, t1=stamp, mass=0.15, std_dev=0.001)


def test_a_text_is_made_once_and_again_when_the_lane_has_more():
    lane = Lane('')
    drawing = Drawing(lane)
    lane.take(judged(1, Decision.ACCEPT))
    look = Look(drawing)
    rows, masses = rows_of(look), MassesView.figure(look)
    signal = drawn(drawing, drawing.items()[0])
    assert rows_of(look) is rows
    assert MassesView.figure(look) is masses
    assert drawn(drawing, drawing.items()[0]) is signal
    lane.take(judged(2, Decision.FAULT))
    assert [row[1] for row in json.loads(rows_of(look))] == ['2', '1']
    assert MassesView.figure(look) is not masses


@pytest.mark.parametrize('view', [MassesView, MeansView, SpreadsView])
def test_a_lane_without_an_item_has_figures_that_say_so(view: type[FigureView]):
    assert json.loads(view.figure(Look(Drawing(Lane('')))))['title']['text']


def test_the_list_is_that_of_the_faults_where_a_viewer_wants_these():
    lane = Lane('')
    drawing = Drawing(lane)
    for verdict in (judged(1, Decision.FAULT), judged(2, Decision.ACCEPT)):
        lane.take(verdict)
    look = Look(drawing, only_faults=True)
    (row,) = json.loads(rows_of(look))
    (item,) = drawing.items(only_faults=True)
    assert row[:3] == [row_key(item), '1', 'FAULT']
    look.only_faults = False
    assert len(json.loads(rows_of(look))) == 2


def zero_row(drawing: Drawing) -> dict[str, dict[str, Any]]:
    """Return the series in the row of the zero by name."""
    series = json.loads(hour(drawing, live=False))['series']
    return {each['name']: each for each in series if each['xAxisIndex'] == 3}


LEFT = 0.5  # mass in kg that is left on the belt
SOUND = 5  # number of items before that


@pytest.fixture(scope='module')
def loaded() -> Recording:
    """Return a line on whose belt the mass `LEFT` stays after `SOUND` items."""
    line = simulated(count=10, seed=3, masses=(0.1345,))
    since = edges_of(line, SOUND - 1)['t4'].stamp + NANOSECONDS // 20
    more = round(LEFT * line.load_cell.counts_per_kg)
    blocks = (
        replace(block, counts=block.counts + more * (block.stamp >= since)) for block in line.blocks
    )
    return replace(line, blocks=tuple(blocks))


def test_the_zero_shows_what_the_belt_reads_where_it_cannot_be_trusted(loaded: Recording):
    lane = lane_of(loaded, held=math.inf)
    out = [Reason.ZERO_OUT_OF_RANGE in item.verdict.reasons for item in reversed(lane.items())]
    assert out == [False] * SOUND + [True] * (10 - SOUND)
    drawing = Drawing(lane)
    read = zero_row(drawing)['as read, ZeroOutOfRange']
    stamps = [item.verdict.t1 for item in reversed(lane.items())][SOUND:]
    assert [at for at, _ in read['data']] == pytest.approx(local_times(stamps).tolist())
    assert [reading for _, reading in read['data']] == pytest.approx([GRAMS * LEFT] * 5, rel=0.05)
    # The readings stay after the samples are dropped.
    lane.forget_signals()
    lane.take(judged(11, Decision.ACCEPT))
    assert zero_row(drawing)['as read, ZeroOutOfRange'] == read


def test_a_zero_that_nobody_has_read_is_not_drawn(loaded: Recording):
    lane = lane_of(loaded)
    lane.forget_signals()
    row = zero_row(Drawing(lane))
    assert 'as read, ZeroOutOfRange' not in row
    assert row['zero']['data'][-1][1] is None


def test_all_that_happened_is_on_one_time_axis():
    lane = Lane('')
    for number in range(1, 21):
        lane.take(judged(number, Decision.FAULT if number % 5 == 0 else Decision.ACCEPT))
        lane.take(BeltNoise(number * NANOSECONDS, 0.1 * number))
    lane.take(Alarms(1, (Alarm('fault', 'NoLoad', '', 7 * NANOSECONDS, 9 * NANOSECONDS),)))
    lane.take(Deed(12 * NANOSECONDS, 'anna', 'zero'))
    lane.take(ZeroChange(13 * NANOSECONDS, -0.001, 0.0, 1e-5))
    figure = json.loads(hour(Drawing(lane), live=False))
    names = [axis['name'] for axis in figure['yAxis']]
    assert names == ['items', 'items/min', 'gross, g', 'zero, g', 'noise, g', 'events']
    assert len({(axis['min'], axis['max']) for axis in figure['xAxis']}) == 1
    series = {each['name']: each for each in figure['series']}
    faults = [stamp_of(at) // NANOSECONDS for at, _ in series['FAULT']['data']]
    assert faults == [5, 10, 15, 20]
    assert len(series['ACCEPT']['data']) == 16
    assert [gap for _, gap in series['noise']['data']][:2] == [0.1, 0.2]
    events = [each for name in ('alarm', 'change') for each in series[name]['data']]
    assert [(each['name'], stamp_of(each['value'][0]) // NANOSECONDS) for each in events] == [
        ('fault NoLoad', 7), ('anna: zero', 12), ('zero -1 g', 13),
    ]  # fmt: skip


def test_the_charts_show_the_part_of_the_time_that_a_viewer_selects():
    lane = Lane('')
    for number in range(1, 21):
        lane.take(judged(number, Decision.FAULT if number % 5 == 0 else Decision.ACCEPT))
    look = Look(Drawing(lane))
    whole = MassesView.figure(look)
    look.span = 4_000_000_000, 10_000_000_001
    assert [row[1] for row in json.loads(rows_of(look))] == ['10', '9', '8', '7', '6', '5', '4']
    (bars,) = json.loads(MassesView.figure(look))['series']
    assert sum(count for _, count in bars['data']) == 5
    look.only_faults = True
    assert [row[1] for row in json.loads(rows_of(look))] == ['10', '5']
    look.span, look.only_faults = None, False
    assert MassesView.figure(look) is whole


def test_arrows_lead_from_item_to_item_and_from_fault_to_fault():
    lane = Lane('')
    for number in range(1, 7):
        lane.take(judged(number, Decision.FAULT if number in (2, 5) else Decision.ACCEPT))
    look = Look(Drawing(lane))

    def shown() -> int:
        return look.item().verdict.item_id

    assert shown() == 6
    for step, faults, expected in (
        (-1, False, 5), (-1, True, 2), (1, False, 3), (1, True, 5), (math.inf, False, 6),
        (-math.inf, False, 1), (-math.inf, True, 2),
    ):  # fmt: skip
        moved = look.move(step, faults=faults)
        assert moved == (expected != 2 or step == -1)
        assert shown() == (expected if moved else 1)
    assert look.place() == (1, 6)


def test_an_item_that_changes_meanwhile_has_a_place():
    class Changing(Lane):
        def items(self, span: Span | None = None) -> list[ShownItem]:
            found = super().items(span)
            verdict = found[0].verdict
            self.take(replace(verdict, mass=verdict.mass + 0.001))
            return found

    lane = Changing('')
    lane.take(judged(1, Decision.ACCEPT))
    assert Look(Drawing(lane), span=(0, 10 * NANOSECONDS)).place() == (1, 1)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a lane shows is drawn once, however many look."""

from dataclasses import replace
import json
import math

from lines import edges_of, simulated
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import Recording
from checkweigher_core.records import GRAMS, NANOSECONDS, Decision, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.lane import Lane
from checkweigher_web.views.control_charts import MeansView, SpreadsView
from checkweigher_web.views.item_list import rows_of
from checkweigher_web.views.masses import MassesView
from checkweigher_web.views.signal import drawn
from checkweigher_web.views.view import FigureView
from checkweigher_web.views.zero import ZeroView


def judged(number: int, decision: Decision) -> Verdict:
    stamp = number * 1_000_000_000
    return Verdict(number, stamp + 1, decision, t1=stamp, mass=0.15, std_dev=0.001)


def test_a_text_is_made_once_and_again_when_the_lane_has_more():
    lane = Lane('')
    drawing = Drawing(lane)
    lane.take(judged(1, Decision.ACCEPT))
    rows, masses = rows_of(drawing), MassesView.figure(drawing)
    signal = drawn(drawing, drawing.items()[0])
    assert rows_of(drawing) is rows
    assert MassesView.figure(drawing) is masses
    assert drawn(drawing, drawing.items()[0]) is signal
    lane.take(judged(2, Decision.FAULT))
    assert [row[1] for row in json.loads(rows_of(drawing))] == ['2', '1']
    assert MassesView.figure(drawing) is not masses


@pytest.mark.parametrize('view', [MassesView, MeansView, SpreadsView, ZeroView])
def test_a_lane_without_an_item_has_figures_that_say_so(view: type[FigureView]):
    assert json.loads(view.figure(Drawing(Lane(''))))['title']['text']


def test_the_list_is_that_of_the_faults_where_a_viewer_wants_these():
    lane = Lane('')
    drawing = Drawing(lane)
    for verdict in (judged(1, Decision.FAULT), judged(2, Decision.ACCEPT)):
        lane.take(verdict)
    (row,) = json.loads(rows_of(drawing, only_faults=True))
    (item,) = drawing.items(only_faults=True)
    assert row[:3] == [row_key(item.key), '1', 'FAULT']
    assert len(json.loads(rows_of(drawing))) == 2


LEFT = 0.5  # kg
SOUND = 5  # items before something is left on the belt


@pytest.fixture(scope='module')
def loaded() -> Recording:
    """Return a line on whose belt something is left behind."""
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
    line, read = json.loads(ZeroView.figure(drawing))['series']
    assert [zero is None for _, zero in line['data']] == out
    assert [at for at, _ in read['data']] == [at for at, zero in line['data'] if zero is None]
    assert [reading for _, reading in read['data']] == pytest.approx([GRAMS * LEFT] * 5, rel=0.05)
    # What was read once stays when the samples have gone.
    lane.forget_signals()
    lane.take(judged(11, Decision.ACCEPT))
    again = json.loads(ZeroView.figure(drawing))['series']
    assert again[1] == read


def test_a_zero_that_nobody_has_read_is_marked_with_its_reason(loaded: Recording):
    lane = lane_of(loaded)
    lane.forget_signals()
    (line,) = json.loads(ZeroView.figure(Drawing(lane)))['series']
    ((begin, end),) = line['markArea']['data']
    assert begin['name'] == 'ZeroOutOfRange'
    times = [at for at, _ in line['data']]
    assert (begin['xAxis'], end['xAxis']) == pytest.approx((times[SOUND - 1], times[-1]), abs=1e-4)

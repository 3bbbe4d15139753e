# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Order, duration and picture of alarms."""

from dataclasses import replace
import json

from lines import edges_of, simulated, without_edges
from shown_lanes import lane_of

from checkweigher_core.records import NANOSECONDS, Alarm, Alarms
from checkweigher_web.drawing import Drawing
from checkweigher_web.lane import Lane
from checkweigher_web.views.alarms import in_order, picture_of, rows

SECOND = NANOSECONDS
STOP = Alarm('stop', 'NoItems', 'look', 10 * SECOND, 12 * SECOND, 2, active=True, duration=3.0)
FAULT = Alarm('fault', 'MissingEdge', 'clean the eye', 5 * SECOND, 9 * SECOND, 7)


def test_the_first_alarm_comes_first_and_says_how_long_it_lasts():
    seen = replace(FAULT, reason='NoLoad', first=1, acknowledged_by='anna')
    found = rows(in_order([STOP, seen, FAULT]), 20 * SECOND)
    assert [(row[0], row[1], row[4], row[5]) for row in found] == [
        ('first', 'fault MissingEdge', '7', 'not acknowledged'),
        ('', 'stop NoItems', '2', 'lasts, 11 s, not acknowledged'),
        ('', 'fault NoLoad', '7', 'acknowledged by anna'),
    ]


def test_an_alarm_that_has_left_the_list_is_over():
    lane = Lane('a')
    lane.take(Alarms(1, (STOP, FAULT)))
    lane.take(Alarms(2, (FAULT,)))
    assert (lane.alarms, lane.over) == ((FAULT,), (STOP,))
    (row,) = rows(lane.over, 0)
    assert (row[0], row[5]) == ('over', '3 s, over')


def test_the_first_alarm_of_items_has_a_picture_that_stays():
    line = simulated(count=6, seed=3, masses=(0.1345,))
    lane = lane_of(without_edges(line, edges_of(line, 3)['t3']))
    drawing = Drawing(lane)
    assert picture_of(drawing) is None
    lane.take(Alarms(1, (STOP, FAULT)))
    about, figure, marks = picture_of(drawing)
    assert 'MissingEdge' in about
    assert 'outfeed eye: t3 is missing' in marks[0]
    assert json.loads(figure)['series'][0]['name'] == 'raw'
    lane.forget_signals()
    assert picture_of(drawing) == (about, figure, marks)
    lane.take(Alarms(2, ()))
    assert picture_of(drawing) is None

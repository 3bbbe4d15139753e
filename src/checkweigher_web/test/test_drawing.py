# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a lane shows is drawn once, however many look."""

import json

from checkweigher_dsp.records import Decision, Verdict
from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.lane import Lane


def judged(number: int, decision: Decision) -> Verdict:
    stamp = number * 1_000_000_000
    return Verdict(number, stamp + 1, decision, t1=stamp, mass=0.15, std_dev=0.001)


def test_a_text_is_made_once_and_again_when_the_lane_has_more():
    lane = Lane('')
    drawing = Drawing(lane)
    lane.take(judged(1, Decision.ACCEPT))
    rows, overview = drawing.rows(), drawing.overview()
    signal = drawing.signal(drawing.items()[0])
    assert drawing.rows() is rows
    assert drawing.overview() is overview
    assert drawing.signal(drawing.items()[0]) is signal
    lane.take(judged(2, Decision.FAULT))
    assert [row[1] for row in json.loads(drawing.rows())] == ['2', '1']
    assert drawing.overview() is not overview


def test_the_list_is_that_of_the_faults_where_a_viewer_wants_these():
    lane = Lane('')
    drawing = Drawing(lane)
    for verdict in (judged(1, Decision.FAULT), judged(2, Decision.ACCEPT)):
        lane.take(verdict)
    (row,) = json.loads(drawing.rows(only_faults=True))
    (item,) = drawing.items(only_faults=True)
    assert row[:3] == [row_key(item.key), '1', 'FAULT']
    assert len(json.loads(drawing.rows())) == 2

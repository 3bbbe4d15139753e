# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

from checkweigher_core.health.findings import Level
from checkweigher_core.ros.ports import STAGES
from checkweigher_core.ros.status_board import StatusBoard, by_lane


def status(name: str, level: Level = Level.OK, message: str = 'well', **values: str) -> object:
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
    return SimpleNamespace(name=name, level=bytes([level]), message=message, values=pairs)


def test_each_lane_has_a_row_and_the_worst_is_first():
    board = StatusBoard()
    for lane in ('lane1/', 'lane2/', ''):
        for node in STAGES:
            board.add(0.0, [status(f'{lane}{node}'), status(f'{lane}{node}: Connections')])
    counted = status('lane2/reject: Verdicts', ACCEPT='7', FAULT='2', UNDER='?', latency_max_ms='3')
    bad = status('lane2/reject: Line', Level.ERROR, 'no masses can come; start it')
    board.add(0.0, [status('lane2/reject'), counted, bad])
    first, *others = by_lane(board.rows(0.0))
    assert (first.lane, first.level) == ('lane2', Level.ERROR)
    assert first.verdicts == (('ACCEPT', '7'), ('FAULT', '2'))
    assert first.counts == (7, 0, 2)
    assert first.worst == 'reject Line: no masses can come; start it'
    assert {each.lane for each in others} == {'lane1', '/'}
    assert all(each.level == Level.OK and not each.worst for each in others)


def test_a_lane_that_is_silent_is_before_those_that_are_well():
    board = StatusBoard()
    for node in STAGES:
        board.add(0.0, [status(f'lane1/{node}: Connections')])
        board.add(10.0, [status(f'lane2/{node}: Connections')])
    assert [(each.lane, each.level) for each in by_lane(board.rows(10.0))] == [
        ('lane1', Level.STALE),
        ('lane2', Level.OK),
    ]

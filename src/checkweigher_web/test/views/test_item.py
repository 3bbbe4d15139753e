# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether a lane weighs, by the diagnostics of its nodes."""

from types import SimpleNamespace

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.ros.ports import STAGES
from checkweigher_core.ros.status_board import StatusBoard
from checkweigher_web.views.item import standstill


def status(name: str, **values: object) -> object:
    pairs = [SimpleNamespace(key=key, value=str(value)) for key, value in values.items()]
    return SimpleNamespace(name=name, level=bytes([Level.OK]), message='well', values=pairs)


def board_of(state: str, *, product: float = 0.0) -> StatusBoard:
    """Return a board that has heard all nodes at 0 s, and the node product then."""
    board = StatusBoard()
    board.add(0.0, [status('driver: Source', source='simulator', state=state)])
    for node in STAGES:
        board.add(0.0, [status(f'{node}: Connections')])
    board.add(product, [status('product: Connections')])
    return board


@pytest.mark.parametrize(
    ('state', 'why'),
    [
        ('running', ''),
        ('inactive', 'weighing is stopped'),
        ('finished', 'weighing has ended, for the source has'),
        ('failed', 'weighing has ended, for the source has failed'),
    ],
)
def test_a_lane_weighs_until_its_driver_says_otherwise(state: str, why: str):
    assert standstill(board_of(state).rows(1.0)) == why


def test_a_lane_of_which_a_node_that_weighs_is_silent_does_not_weigh():
    board = board_of('running', product=-9.0)
    assert standstill(board.rows(2.0)) == ''  # the node product only counts
    assert standstill(board.rows(7.0)) == 'silent for 7 s'
    board.add(6.0, [status('driver: Source', state='running')])
    assert standstill(board.rows(7.0)) == 'silent for 7 s'


def test_a_lane_that_ends_before_its_first_report_does_not_weigh():
    board = StatusBoard()
    board.expect(1.0, 'late')
    assert standstill(board.rows(2.0)) == ''
    assert standstill(board.rows(5.0)) == 'silent for 4 s'
    board.add(5.0, [status(f'late/{node}: Connections') for node in STAGES])
    assert standstill(board.rows(6.0)) == ''


def test_nodes_that_nobody_has_heard_yet_are_no_standstill():
    board = StatusBoard()
    board.add(0.0, [status('product: Connections')])
    assert standstill(board.rows(0.0)) == ''

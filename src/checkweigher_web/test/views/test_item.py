# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""State of a lane from the diagnostics of its nodes, and scale of its reading."""

import math
from types import SimpleNamespace

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.records import Decision, Verdict
from checkweigher_core.ros.ports import STAGES
from checkweigher_core.ros.status_board import StatusBoard
from checkweigher_production.recipes import Product
from checkweigher_production.statistics import ProductionStatistics
from checkweigher_web.lane import ShownItem
from checkweigher_web.views.item import reading, standstill


def status(name: str, **values: object) -> object:
    pairs = [SimpleNamespace(key=key, value=str(value)) for key, value in values.items()]
    return SimpleNamespace(name=name, level=bytes([Level.OK]), message='well', values=pairs)


def board_of(state: str, *, product: float = 0.0) -> StatusBoard:
    """Return a board with reports of all nodes at 0 s, and of the node product at `product` s."""
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
    assert standstill(board.rows(2.0)) == ''  # the node product does not weigh
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


def test_the_scale_has_the_limits_and_the_items_of_the_same_batch():
    product = Product('crisps', 0.150, tare=0.004, tu1=0.14325, tu2=0.1365)
    verdicts = [
        Verdict(n, n, Decision.ACCEPT, mass=mass, product='crisps', batch=batch,
                lower_limit=0.14725, upper_limit=0.169)
        for n, mass, batch in (
            (4, 0.155, 'L2'), (3, 0.2, 'L2'), (2, math.nan, 'L2'), (1, 0.15, 'L1'),
        )
    ]  # fmt: skip
    items = [ShownItem(each) for each in verdicts]
    scale = reading(items[0], items, ProductionStatistics(product).summary('L2'))['scale']
    names = ['TU2 140.5', 'TU1 = lower 147.25', 'nominal 154', 'upper 169']
    assert [name for name, *_ in scale['limits']] == names
    # The margins are 12 % of the range of the limits, which is 28.5 g.
    low, width = 140.5 - 3.42, 28.5 + 2 * 3.42
    places = [at for _, at, _ in scale['limits']]
    limits = [(mass - low) / width for mass in (140.5, 147.25, 154, 169)]
    assert places == pytest.approx(limits, abs=1e-4)
    assert scale['accepted'] == [places[1], places[3]]
    assert scale['at'] == pytest.approx((155 - low) / width, abs=1e-4)
    assert scale['dots'] == [[1.0, 'ACCEPT']]  # beyond the scale; others are not shown


def test_a_driver_in_an_unknown_state_is_not_said_to_weigh():
    assert standstill(board_of('melted').rows(1.0)) == "unknown state 'melted'"

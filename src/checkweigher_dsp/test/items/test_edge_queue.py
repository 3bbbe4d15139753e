# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges in any order of arrival wait for the samples in the order of their stamps."""

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_dsp.items.edge_queue import EdgeQueue


def _edge(stamp: int) -> EyeEdge:
    return EyeEdge(stamp, Eye.INFEED, blocked=True)


def _queue(*stamps: int) -> EdgeQueue:
    queue = EdgeQueue(lateness=10)
    for stamp in stamps:
        queue.add(_edge(stamp))
    return queue


def _stamps(edges: list[EyeEdge]) -> list[int]:
    return [edge.stamp for edge in edges]


def test_edges_come_out_in_order_as_far_as_a_condition_holds():
    queue = _queue(5, 3, 9, 7)

    assert _stamps(queue.pop_while(lambda edge: edge.stamp < 8)) == [3, 5, 7]
    assert _stamps(queue.pop_all()) == [9]


def test_what_is_far_behind_another_edge_waits_for_the_next_samples():
    queue = _queue(90, 100, 95, 89)

    assert _stamps(queue.pop_while(lambda edge: True)) == [90, 95, 100]
    queue.admit_strays()
    assert _stamps(queue.pop_while(lambda edge: True)) == [89]


def test_what_is_far_behind_another_edge_is_of_a_clock_that_goes_back():
    queue = _queue(95, 9, 7)

    new = queue.pop_of_new_clock(5, forward=False)
    assert sorted(_stamps(new)) == [7, 9]
    assert _stamps(queue.pop_all()) == [95]
    queue.put_back(new)
    queue.add(_edge(20))
    assert _stamps(queue.pop_while(lambda edge: True)) == [7, 9, 20]


def test_what_is_ahead_of_the_samples_is_of_a_clock_that_goes_forward():
    queue = _queue(95, 205, 89)

    assert _stamps(queue.pop_of_new_clock(200, forward=True)) == [205]
    assert _stamps(queue.pop_all()) == [89, 95]


def test_what_no_sample_reaches_soon_enough_is_dropped():
    queue = _queue(95, 2_000_000, 100)
    queue.drop_after(150)
    queue.add(_edge(101))

    assert _stamps(queue.pop_while(lambda edge: True)) == [95, 101]

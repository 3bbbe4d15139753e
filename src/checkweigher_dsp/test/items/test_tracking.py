# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pairing edges to items where eyes miss some: the tests know which product each edge is of."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from synthetic_line import make_line

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.tracking import ItemTracker

MS = 1_000_000
DEBOUNCE = 5 * MS
MAX_TRANSIT = 2000 * MS
NAMES = ('t1', 't2', 't3', 't4')


def _track(edges):
    """Return all items that a tracker makes of edges, also those that never left."""
    tracker = ItemTracker(DEBOUNCE, MAX_TRANSIT)
    items = [item for edge in edges for item in tracker.add(edge)]
    items += tracker.expire(edges[-1].stamp + 10 * MAX_TRANSIT)
    assert [item.item_id for item in items] == list(range(1, tracker.belt.count + 1))
    return items


def _reasons(items):
    return [list(item.faults) for item in items]


def _is(item, product):
    return (item.t1, item.t2, item.t3) == (product.t1, product.t2, product.t3)


def _assert_whole_but(items, products, faulty):
    """Assert one item for each product, all whole and rightly paired but those of `faulty`."""
    assert len(items) == len(products)
    for number, (item, product) in enumerate(zip(items, products, strict=True)):
        if number in faulty:
            assert item.faults
        else:
            assert not item.faults
            assert _is(item, product)


def _flicker(edges, stamp):
    """Insert two edges of the eye that switched at `stamp`, 1 and 2 ms later."""
    position = next(i for i, edge in enumerate(edges) if edge.stamp == stamp)
    edge = edges[position]
    more = [
        replace(edge, stamp=stamp + MS, blocked=not edge.blocked),
        replace(edge, stamp=stamp + 2 * MS),
    ]
    return sorted([*edges, *more], key=lambda edge: edge.stamp)


def test_whole_items_have_their_four_edges():
    line = make_line()

    items = _track(line.edges())

    _assert_whole_but(items, line.products, ())
    assert [item.t4 for item in items] == [product.t4 for product in line.products]
    # What was on the belt before each: nothing, then the one before it.
    assert [item.left_before for item in items] == [None, *(p.t4 for p in line.products[:2])]


@pytest.mark.parametrize('spacing', [0.21, 0.35, 0.6, 3.0])
@pytest.mark.parametrize(('name', 'costs'), [('t1', {1}), ('t2', {1}), ('t3', {1}), ('t4', set())])
def test_one_lost_edge_costs_one_item(spacing, name, costs):
    line = make_line((0.1,) * 5, spacing=spacing)

    items = _track(line.edges(without=[(1, name)]))

    if spacing == 0.21 and name in ('t3', 't4'):
        costs = costs | {2}  # it enters before this one is known to be gone
    _assert_whole_but(items, line.products, costs)
    assert all(Reason.MISSING_EDGE in items[number].faults for number in costs & {1})


@pytest.mark.parametrize('name', NAMES[:3])
def test_what_was_seen_of_a_faulty_item_is_its_own(name):
    line = make_line((0.1,) * 4)
    product = line.products[1]

    item = _track(line.edges(without=[(1, name)]))[1]

    for seen in {'t1', 't2', 't3'} - {name}:
        assert getattr(item, seen) == getattr(product, seen)
    assert getattr(item, name) is None


@pytest.mark.parametrize(('clears', 'blocks', 'costs'), [('t2', 't1', {1, 2}), ('t4', 't3', {2})])
def test_a_clearing_eye_belongs_to_no_item_that_is_gone(clears, blocks, costs):
    line = make_line((0.1,) * 4)

    items = _track(line.edges(without=[(1, clears), (2, blocks)]))

    _assert_whole_but(items, line.products, costs)
    assert getattr(items[1], clears) is None
    assert getattr(items[2], clears) == getattr(line.products[2], clears)


@pytest.mark.parametrize('name', ['t1', 't2'])
def test_a_chattering_infeed_eye_is_a_fault_of_this_item_alone(name):
    line = make_line()
    items = _track(_flicker(line.edges(), getattr(line.products[1], name)))

    _assert_whole_but(items, line.products, {1})
    assert _reasons(items)[1] == [Reason.CHATTERING_EYE]


@pytest.mark.parametrize('spacing', [0.25, 0.6])
@pytest.mark.parametrize('name', ['t3', 't4'])
def test_a_chattering_outfeed_eye_makes_no_further_items(name, spacing):
    line = make_line(spacing=spacing)
    stamp = getattr(line.products[1], name)

    items = _track(_flicker(line.edges(), stamp))

    # The item has been weighed by then: its t3 is the first edge.
    _assert_whole_but(items, line.products, ())
    assert items[1].t4 == max(line.products[1].t4, stamp + 2 * MS)


def test_two_on_the_belt_at_once_are_both_faults():
    line = make_line((0.1,) * 4, spacing=(0.6, 0.15, 0.6))

    items = _track(line.edges())

    _assert_whole_but(items, line.products, {1, 2})
    assert _reasons(items)[1:3] == [[Reason.DISTANCE_FAULT]] * 2
    assert all(_is(item, product) for item, product in zip(items, line.products, strict=True))


@pytest.mark.parametrize('lost', ['t1', 't2'])
def test_two_on_the_belt_are_faults_also_where_the_eye_half_missed_the_second(lost):
    line = make_line((0.1,) * 3, length=0.05, spacing=(0.07, 0.6))

    items = _track(line.edges(without=[(1, lost)]))

    _assert_whole_but(items, line.products, {0, 1})
    assert Reason.DISTANCE_FAULT in items[0].faults


def test_a_product_longer_than_the_belt_is_one_fault():
    line = make_line((0.1,) * 3, length=0.25, spacing=1.0)

    items = _track(line.edges())

    assert _reasons(items) == [[Reason.PRODUCT_TOO_LONG, Reason.MISSING_EDGE]] * 3
    assert all(_is(item, product) for item, product in zip(items, line.products, strict=True))


@pytest.mark.parametrize('lost', NAMES)
def test_chatter_together_with_a_lost_edge_is_one_fault(lost):
    line = make_line((0.1,) * 3)
    for flickering in set(NAMES) - {lost}:
        stamp = getattr(line.products[1], flickering)

        items = _track(_flicker(line.edges(without=[(1, lost)]), stamp))

        assert len(items) == 3
        assert not items[0].faults
        assert not items[2].faults


@pytest.mark.parametrize('spacing', [0.35, 0.6, 1.0, 2.5])
def test_an_item_taken_off_costs_itself_and_at_most_the_next(spacing):
    line = make_line((0.1,) * 6, spacing=spacing)

    items = _track(line.edges(without=[(1, 't3'), (1, 't4')]))

    assert Reason.MISSING_EDGE in items[1].faults
    assert len(items) == 6
    assert all(_is(items[number], line.products[number]) for number in (0, 2, 3, 4, 5))
    assert not any(items[number].faults for number in (0, 3, 4, 5))
    # It is overdue 1.5 transits and its length after its entry, at 0.4 s.
    assert bool(items[2].faults) == (spacing < 0.4)


def test_an_item_taken_off_before_any_was_whole_is_forgotten_in_a_pause():
    # How long an item takes is not known yet, so all that follow look like two on the belt.
    line = make_line((0.1,) * 5, spacing=(0.6, 0.6, 2.5, 0.6))

    items = _track(line.edges(without=[(0, 't3'), (0, 't4')]))

    # After the pause the first edge may be of the one that was given up.
    _assert_whole_but(items, line.products, {0, 1, 2, 3})


def test_the_state_of_the_eyes_at_start_up_is_no_item():
    line = make_line()
    states = [EyeEdge(line.start, eye, False) for eye in Eye]

    _assert_whole_but(_track([*states, *line.edges()]), line.products, ())
    assert ItemTracker(DEBOUNCE, MAX_TRANSIT).add(states[0]) == []


@pytest.mark.parametrize('seen', [('t2', 't3', 't4'), ('t3', 't4'), ('t3',)])
@pytest.mark.parametrize('states', [False, True])
def test_an_item_on_the_belt_at_start_up_is_one_fault(seen, states):
    line = make_line()
    missing = [(0, name) for name in NAMES if name not in seen]
    initial = [EyeEdge(line.start, eye, False) for eye in Eye if states]

    items = _track(initial + line.edges(without=missing))

    _assert_whole_but(items, line.products, {0})
    assert items[0].t3 == line.products[0].t3


def test_an_item_at_the_outfeed_eye_at_start_up_is_none_of_ours():
    line = make_line()

    items = _track(line.edges(without=[(0, name) for name in ('t1', 't2', 't3')]))

    _assert_whole_but(items, line.products[1:], ())


@pytest.mark.parametrize(('seeing', 'spacing'), [(Eye.OUTFEED, 0.6), (Eye.INFEED, 3.0)])
def test_with_a_dead_eye_each_item_is_one_fault(seeing, spacing):
    line = make_line(spacing=spacing)

    items = _track([edge for edge in line.edges() if edge.eye == seeing])

    assert _reasons(items) == [[Reason.MISSING_EDGE]] * 3
    if seeing is Eye.OUTFEED:
        assert [item.t3 for item in items] == [product.t3 for product in line.products]


def test_an_item_is_given_up_only_after_the_longest_transit():
    first, second = make_line((0.1,)).edges()[:2]
    tracker = ItemTracker(DEBOUNCE, MAX_TRANSIT)
    tracker.add(first)
    tracker.add(second)

    assert tracker.expire(first.stamp + MAX_TRANSIT) == []
    assert [item.t1 for item in tracker.expire(first.stamp + MAX_TRANSIT + 1)] == [first.stamp]


NAME = st.sampled_from(NAMES)
GAPS = st.sampled_from([0.21, 0.25, 0.3, 0.31, 0.42, 0.5, 0.6, 0.61, 0.77, 1.0, 1.9, 2.5])


def _assert_never_wrongly_paired(line, edges):
    items = _track(edges)
    products = {product.t1: product for product in line.products}
    for item in items:
        if not item.faults:
            assert _is(item, products[item.t1])
            assert item.t1 < item.t2
            assert item.t1 < item.t3


# Four lost edges can look just like one slower, longer item, three cannot.
@settings(max_examples=300)
@given(
    st.lists(GAPS, min_size=5, max_size=5),
    st.sets(st.tuples(st.integers(0, 5), NAME), max_size=3),
    st.lists(st.booleans(), min_size=24, max_size=24),
    st.sampled_from([0.5, 1.0, 1.5]),
)
def test_a_wrong_pairing_is_never_reported_as_whole(gaps, lost, doubled, speed):
    line = make_line((0.1,) * 6, spacing=gaps, speed=speed)
    edges = line.edges(without=lost)

    _assert_never_wrongly_paired(
        line, [e for e, twice in zip(edges, doubled, strict=False) for _ in range(1 + twice)]
    )


@settings(max_examples=200)
@given(
    st.lists(st.sampled_from([0.06, 0.1, 0.15, 0.19]) | GAPS, min_size=5, max_size=5),
    # Not of the first one: the edge of an item that was there before the tracker cannot be known.
    st.tuples(st.integers(1, 5), NAME),
    st.sampled_from([0.03, 0.05]),
)
def test_nor_with_many_on_the_belt_and_one_lost_edge(gaps, lost, length):
    line = make_line((0.1,) * 6, spacing=gaps, length=length)

    _assert_never_wrongly_paired(line, line.edges(without=[lost]))


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(1, 400), st.sampled_from(list(Eye)), st.booleans())))
def test_no_order_of_edges_loses_an_item_or_finishes_one_twice(steps):
    stamp, edges = 0, []
    for delay, eye, blocked in steps:
        stamp += delay * MS
        edges.append(EyeEdge(stamp, eye, blocked))

    # _track asserts that the ids are 1..n, each once.
    items = _track([*edges, EyeEdge(stamp + 1, Eye.INFEED, False)])

    assert all(item.faults or item.t3 is not None for item in items)


def _edges(*events):
    """Return edges of (ms, name)."""
    eyes = dict(
        zip(NAMES, [(eye, blocked) for eye in Eye for blocked in (True, False)], strict=True)
    )
    return [EyeEdge(ms * MS, *eyes[name]) for ms, name in events]


WHOLE = [(1000, 't1'), (1100, 't2'), (1200, 't3'), (1300, 't4')]


def test_a_belt_that_slows_down_under_two_items_makes_no_third_one():
    # The second one is yet entering when the first one leaves, at the usual time of the second.
    first = [(2000, 't1'), (2100, 't2'), (2285, 't3'), (2485, 't4')]
    second = [(2115, 't1'), (2315, 't2'), (2515, 't3'), (2715, 't4')]

    items = _track(_edges(*WHOLE, *sorted(first + second)))

    assert [item.t3 for item in items] == [1200 * MS, 2285 * MS, 2515 * MS]
    assert [bool(item.faults) for item in items] == [False, True, True]


def test_a_belt_that_stands_still_while_an_item_leaves_makes_no_further_one():
    # The t4 of the first one is when that of the second was due.
    first = [(2000, 't1'), (2100, 't2'), (2200, 't3'), (2450, 't4')]
    second = [(2150, 't1'), (2250, 't2'), (2500, 't3'), (2600, 't4')]

    assert len(_track(_edges(*WHOLE, *sorted(first + second)))) == 3


@pytest.mark.parametrize('state', [False, True])
def test_an_eye_that_clears_first_of_all_has_seen_an_item_but_for_its_state(state):
    first = _edges((1100, 't2'), *([(1101, 't4')] if state else []), (9000, 't1'), (9100, 't2'))

    items = _track(first)

    assert _reasons(items)[:-1] == ([] if state else [[Reason.START_UP, Reason.MISSING_EDGE]])


def test_a_flicker_after_a_lost_edge_is_no_item():
    # The t2 at 1100 is lost, what flickers there is not.
    flicker = [(1102, 't1'), (1104, 't2'), (1106, 't1'), (1108, 't2')]
    items = _track(_edges((1000, 't1'), *flicker, (1200, 't3'), (1300, 't4')))

    assert [(item.t1, item.t3) for item in items] == [(1000 * MS, 1200 * MS)]
    assert Reason.CHATTERING_EYE in items[0].faults

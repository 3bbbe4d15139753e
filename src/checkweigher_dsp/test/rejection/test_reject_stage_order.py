# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every item that the eyes show has one verdict, with or without a mass, in any order."""

from dataclasses import replace
import math

from hypothesis import assume, given
from hypothesis import strategies as st
import pytest

from checkweigher_dsp.items.tracking import ItemTracker
from checkweigher_dsp.records import NANOSECONDS, Decision, Eye, EyeEdge, MassEstimate
from checkweigher_dsp.rejection.items import RejectItems
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage

MILLISECOND = NANOSECONDS // 1000
BELT = 0.2  # m
# 0.5 m at 1 m/s: told 500 - 20 ms after t3, judged 50 ms before that.
PARAMETERS = RejectParameters(
    lower_limit=0.1, upper_limit=0.2, actuator_delay=0.02, verdict_margin=0.05
)
REJECT_TIME, DUE = 480 * MILLISECOND, 430 * MILLISECOND


def _item(number, start=NANOSECONDS, pitch=660 * MILLISECOND):
    """Edges and estimate of an item of 0.1 m at 1 m/s, numbered from 1."""
    t1 = start + (number - 1) * pitch
    t2, t3, t4 = t1 + 100 * MILLISECOND, t1 + 200 * MILLISECOND, t1 + 300 * MILLISECOND
    edges = [
        EyeEdge(t1, Eye.INFEED, True),
        EyeEdge(t2, Eye.INFEED, False),
        EyeEdge(t3, Eye.OUTFEED, True),
        EyeEdge(t4, Eye.OUTFEED, False),
    ]
    return edges, MassEstimate(number, t1, t2, t3, mass=0.15, std_dev=1e-4, line_speed=1.0)


def _play(stage, timed):
    """Give a stage what comes at which time, with the clock looked at every 10 ms besides."""
    verdicts = []
    now = min(when for when, _ in timed)
    for when, what in sorted(timed, key=lambda each: each[0]):
        while now < when:
            verdicts += [(now, verdict) for verdict in stage.advance(now)]
            now += 10 * MILLISECOND
        verdicts += [(when, verdict) for verdict in stage.take(what, when)]
    for end in range(now, now + 6 * NANOSECONDS, 10 * MILLISECOND):
        verdicts += [(end, verdict) for verdict in stage.advance(end)]
    return verdicts


def _as_they_happen(count, delay, without=()):
    """Edges when they happen and estimates `delay` after t3, but for those of `without`."""
    timed = []
    for number in range(1, count + 1):
        edges, estimate = _item(number)
        timed += [(edge.stamp, edge) for edge in edges]
        if number not in without:
            timed.append((estimate.t3 + delay, estimate))
    return timed


def test_what_is_weighed_in_time_is_judged_by_its_mass():
    verdicts = _play(RejectStage(PARAMETERS, BELT), _as_they_happen(3, 20 * MILLISECOND))

    assert [(v.item_id, v.estimate_id) for _, v in verdicts] == [(1, 1), (2, 2), (3, 3)]
    for when, verdict in verdicts:
        assert (verdict.decision, verdict.late) == (Decision.ACCEPT, False)
        assert verdict.reject_at == verdict.t3 + REJECT_TIME
        assert when == verdict.t3 + 20 * MILLISECOND


def test_what_is_not_weighed_is_a_fault_in_time_and_the_items_after_it_are_weighed():
    timed = _as_they_happen(4, 20 * MILLISECOND, without=(2, 3))

    verdicts = _play(RejectStage(PARAMETERS, BELT), timed)

    assert [v.item_id for _, v in verdicts] == [1, 2, 3, 4]
    assert [v.decision for _, v in verdicts] == [
        Decision.ACCEPT, Decision.FAULT, Decision.FAULT, Decision.ACCEPT
    ]  # fmt: skip
    for when, verdict in verdicts[1:3]:
        _, estimate = _item(verdict.item_id)
        assert verdict.reasons == ('NoEstimate',)
        assert (verdict.t1, verdict.t3, verdict.estimate_id) == (estimate.t1, estimate.t3, 0)
        assert math.isnan(verdict.mass)
        assert verdict.reject_at == estimate.t3 + REJECT_TIME
        assert DUE <= when - estimate.t3 <= DUE + 10 * MILLISECOND  # as often as time is looked at
        assert not verdict.late


def test_masses_show_how_edges_are_paired_where_the_first_product_was_taken_off():
    timed = _as_they_happen(6, 20 * MILLISECOND, without=(1, 5))
    taken_off = _item(1)[0][2:]
    timed = [(when, what) for when, what in timed if what not in taken_off]

    verdicts = _play(RejectStage(PARAMETERS, BELT), timed)

    without_mass = _item(5)[1]
    ((when, fault),) = [(t, v) for t, v in verdicts if v.t1 == without_mass.t1]
    assert (fault.reasons, fault.t3) == (('NoEstimate',), without_mass.t3)
    assert DUE <= when - without_mass.t3 <= DUE + 10 * MILLISECOND
    assert len(verdicts) == len({verdict.t1 for _, verdict in verdicts}) == 6


def test_an_item_whose_entry_the_segmenter_has_missed_is_judged_where_it_leaves():
    stage = RejectStage(PARAMETERS, BELT)
    (t1, t2, t3, t4), weighed = _item(1)
    missed = replace(weighed, t1=None, t3=None, mass=math.nan, reasons=('StartUp',))

    verdicts = [verdict for edge in (t1, t2) for verdict in stage.take(edge, edge.stamp)]
    verdicts += stage.take(missed, t2.stamp + MILLISECOND)
    assert verdicts == []
    verdicts = [verdict for edge in (t3, t4) for verdict in stage.take(edge, edge.stamp)]

    (fault,) = [verdict for verdict in verdicts if verdict.t1 == t1.stamp]
    assert (fault.decision, fault.reasons) == (Decision.FAULT, ('StartUp',))
    assert (fault.t3, fault.reject_at) == (t3.stamp, t3.stamp + REJECT_TIME)
    assert stage.take(replace(missed, item_id=2, t2=None, t3=t3.stamp), t4.stamp) == []


def test_a_mass_that_waits_for_its_edges_costs_nothing_with_those_of_others(
    monkeypatch: pytest.MonkeyPatch,
):
    looked_up = []
    has_judged = RejectItems.has_judged

    def count(items: RejectItems, estimate: MassEstimate) -> bool:
        looked_up.append(estimate.item_id)
        return has_judged(items, estimate)

    monkeypatch.setattr(RejectItems, 'has_judged', count)
    stage = RejectStage(PARAMETERS, BELT)
    items = [_item(number) for number in range(1, 51)]
    for _, estimate in items:
        assert not stage.take(estimate)
    verdicts = [verdict for edges, _ in items for edge in edges for verdict in stage.take(edge)]
    assert [verdict.estimate_id for verdict in verdicts] == list(range(1, 51))
    assert len(looked_up) == 2 * len(items)  # when it comes, and with its first edge


def test_masses_far_ahead_of_their_edges_wait_for_them():
    stage = RejectStage(replace(PARAMETERS, deadlines=False), BELT)
    items = [_item(number) for number in range(1, 151)]
    assert [stage.add_estimate(estimate) for _, estimate in items] == [[]] * 150

    verdicts = [verdict for edges, _ in items for edge in edges for verdict in stage.add_edge(edge)]

    assert [verdict.decision for verdict in verdicts] == [Decision.ACCEPT] * 150


def test_a_late_mass_is_counted_and_changes_nothing():
    stage = RejectStage(PARAMETERS, BELT)

    verdicts = _play(stage, _as_they_happen(3, 450 * MILLISECOND))

    assert [v.reasons for _, v in verdicts] == [('NoEstimate',)] * 3
    assert stage.late_estimates == 3


def test_without_time_every_mass_is_waited_for():
    stage = RejectStage(PARAMETERS, BELT)
    items = [_item(number) for number in range(1, 4)]
    assert [stage.add_edge(edge) for edges, _ in items for edge in edges] == [[]] * 12

    verdicts = [verdict for _, estimate in items for verdict in stage.add_estimate(estimate)]

    assert [v.decision for v in verdicts] == [Decision.ACCEPT] * 3


def test_a_verdict_after_its_reject_time_says_so():
    stage = RejectStage(replace(PARAMETERS, verdict_margin=0.0), BELT)
    edges, estimate = _item(1)
    for edge in edges:
        stage.add_edge(edge, edge.stamp)
    # The clock was not read: the process had no processor time.
    (verdict,) = stage.add_estimate(estimate, estimate.t3 + REJECT_TIME + 1)

    assert verdict.late
    assert stage.late_verdicts == 1


def test_time_runs_from_the_arrival_of_t3_however_fast_the_stamps_come():
    stage = RejectStage(PARAMETERS, BELT)
    verdicts = []
    for number in range(1, 11):  # 6.6 s of stamps in 10 ms
        edges, _ = _item(number)
        for edge in edges:
            verdicts += stage.add_edge(edge, number * MILLISECOND)

    assert verdicts == []
    assert stage.due == MILLISECOND + DUE


def test_a_segmenter_that_counts_from_one_again_spoils_no_number():
    stage = RejectStage(PARAMETERS, BELT)
    timed = _as_they_happen(3, 20 * MILLISECOND)
    for number in (4, 5):
        edges, estimate = _item(number)
        timed += [(edge.stamp, edge) for edge in edges]
        timed.append((estimate.t3 + MILLISECOND, replace(estimate, item_id=number - 3)))

    verdicts = _play(stage, timed)

    assert [v.item_id for _, v in verdicts] == [1, 2, 3, 4, 5]
    assert [v.estimate_id for _, v in verdicts] == [1, 2, 3, 1, 2]
    assert [v.t1 for _, v in verdicts] == [_item(number)[1].t1 for number in range(1, 6)]
    assert stage.late_estimates == 0


def test_a_segmenter_started_with_an_item_on_the_belt_makes_no_two_of_it():
    stage = RejectStage(PARAMETERS, BELT)
    edges, estimate = _item(1)
    verdicts = []
    # It started again between t2 and t3: it gave the item up, and then saw it leave.
    first = replace(estimate, t3=None, reasons=('SourceRestarted',), mass=math.nan)
    second = replace(
        estimate, item_id=2, t1=None, t2=None, reasons=('MissingEdge', 'StartUp'), mass=math.nan
    )
    for what in (*edges[:2], first, *edges[2:], second, *_item(2)[0]):
        verdicts += stage.take(what)

    assert [v.reasons for v in verdicts] == [('SourceRestarted',)]
    assert stage.late_estimates == 1
    (verdict,) = stage.add_estimate(replace(_item(2)[1], item_id=3))
    assert (verdict.decision, verdict.estimate_id) == (Decision.ACCEPT, 3)


def test_a_stage_that_is_started_late_takes_up_the_numbers_of_the_segmenter():
    stage = RejectStage(PARAMETERS, BELT)
    verdicts = []
    for number in (51, 52, 53):
        edges, estimate = _item(number)
        for edge in edges:
            verdicts += stage.add_edge(edge, edge.stamp)
        if number != 52:
            verdicts += stage.add_estimate(estimate, estimate.t3 + 101 * MILLISECOND)

    assert [v.item_id for v in verdicts] == [51, 52, 53]
    assert verdicts[1].reasons == ('NoEstimate',)


def test_the_same_recording_again_is_a_stream_of_new_items():
    stage = RejectStage(PARAMETERS, BELT)
    verdicts = []
    for run in (0, 5):
        for number in range(1, 6):
            edges, estimate = _item(number)
            for edge in edges:
                stage.add_edge(edge)
            verdicts += stage.add_estimate(replace(estimate, item_id=number + run))

    assert [v.item_id for v in verdicts] == list(range(1, 11))
    assert {v.decision for v in verdicts} == {Decision.ACCEPT}


def test_a_mass_of_what_the_eyes_did_not_show_has_no_verdict():
    stage = RejectStage(PARAMETERS, BELT)
    for number in (1, 2):
        for edge in _item(number)[0]:
            stage.add_edge(edge)
    stranger = MassEstimate(7, 1_300_000_001, 1_400_000_001, 1_500_000_001, mass=0.15)

    verdicts = [*stage.add_estimate(stranger), *stage.add_estimate(_item(2)[1])]

    assert [v.t3 for v in verdicts] == [_item(2)[1].t3]
    assert stage.add_estimate(MassEstimate(9, None, None, None, mass=0.15)) == []
    for number in range(1100):  # of times to come, and so they might be ahead of their edges
        assert stage.add_estimate(_item(1000 + number)[1]) == []
    assert _play(stage, [(_item(3)[1].t3, edge) for edge in _item(3)[0]])[0][1].reasons == (
        'NoEstimate',
    )
    assert stage.unknown_estimates >= 101


def test_no_mass_is_known_of_items_whose_edges_are_doubted():
    stage = RejectStage(PARAMETERS, BELT)
    verdicts = []
    for number in (1, 2, 3):
        edges, estimate = _item(number)
        stage.doubted = number == 2
        for what in (*edges, estimate):
            verdicts += stage.take(what)

    assert [v.reasons for v in verdicts] == [(), ('ForeignPublisher',), ()]
    assert math.isnan(verdicts[1].mass)


@pytest.mark.parametrize('number', [0, 2**64 - 1])
def test_a_senseless_number_is_not_taken_up(number):
    stage = RejectStage(PARAMETERS, BELT)
    stage.add_estimate(MassEstimate(number, None, None, None, reasons=('BadWindow',)))
    edges, estimate = _item(2)
    for edge in edges:
        stage.add_edge(edge)

    assert [v.item_id for v in stage.add_estimate(estimate)] == [2]


def test_an_item_taken_off_the_belt_has_one_verdict_too():
    stage = RejectStage(PARAMETERS, BELT)
    # After a whole one, which shows how long an item takes.
    taken_off, _ = _item(1)
    others = [_item(0)[0], *(_item(number)[0] for number in range(5, 8))]  # 2 s later: given up
    timed = sorted(
        ((edge.stamp, edge) for edges in (taken_off[:2], *others) for edge in edges),
        key=lambda each: each[0],
    )

    reasons = {verdict.t1: verdict.reasons for _, verdict in _play(stage, timed)}

    assert reasons == {
        taken_off[0].stamp: ('MissingEdge', 'NoEstimate'),
        **{edges[0].stamp: ('NoEstimate',) for edges in others},
    }


# 0.2 m at 0.1 m/s, and 2 s in which its edge may yet come.
GIVEN_UP = 4 * NANOSECONDS


@pytest.mark.parametrize('seen', [1, 2])
def test_an_item_that_nothing_comes_after_is_given_up_by_time_alone(seen):
    stage = RejectStage(PARAMETERS, BELT)
    edges, _ = _item(1)

    ((when, verdict),) = _play(stage, [(edge.stamp, edge) for edge in edges[:seen]])

    assert verdict.reasons == ('MissingEdge', 'NoEstimate')
    assert (verdict.item_id, verdict.t1, verdict.t3) == (1, edges[0].stamp, None)
    # A second more for its estimate.
    assert 0 <= when - edges[0].stamp - GIVEN_UP - NANOSECONDS <= 20 * MILLISECOND
    assert stage.due is None


def test_the_time_at_which_an_item_is_given_up_is_known_before():
    stage = RejectStage(PARAMETERS, BELT)
    edges, _ = _item(1)
    for edge in edges[:2]:
        stage.add_edge(edge, edge.stamp + MILLISECOND)

    assert stage.due == edges[0].stamp + MILLISECOND + GIVEN_UP + 1
    assert stage.advance(stage.due) == []
    assert stage.due == edges[0].stamp + MILLISECOND + GIVEN_UP + 1 + NANOSECONDS


@pytest.mark.parametrize('estimated', [False, True])
def test_an_item_that_comes_after_it_was_given_up_has_no_second_verdict(estimated):
    stage = RejectStage(PARAMETERS, BELT)
    edges, estimate = _item(1)
    later = [replace(edge, stamp=edge.stamp + 8 * NANOSECONDS) for edge in edges[2:]]
    timed = [(edge.stamp, edge) for edge in (*edges[:2], *later)]
    if estimated:  # as the segmenter does it, by the samples
        fault = replace(estimate, t3=None, reasons=('MissingEdge',), mass=math.nan)
        timed.append((edges[0].stamp + GIVEN_UP + 10 * MILLISECOND, fault))
    next_edges, next_estimate = _item(1, start=12 * NANOSECONDS)
    timed += [(edge.stamp, edge) for edge in next_edges]
    timed.append((next_estimate.t3 + MILLISECOND, replace(next_estimate, item_id=2)))

    verdicts = [verdict for _, verdict in _play(stage, timed)]

    reasons = ('MissingEdge',) if estimated else ('MissingEdge', 'NoEstimate')
    assert [(v.item_id, v.reasons) for v in verdicts] == [(1, reasons), (2, ())]


def test_edges_before_the_load_cell_is_known_are_not_lost():
    stage = RejectStage(PARAMETERS)
    for edge in _item(1)[0]:
        assert stage.add_edge(edge, edge.stamp) == []
    stage.set_weigh_length(BELT, 3 * NANOSECONDS)

    (verdict,) = stage.advance(3 * NANOSECONDS)

    assert verdict.reasons == ('NoEstimate',)
    assert verdict.late


@given(st.data())
def test_every_item_has_exactly_one_verdict_in_any_order_of_arrival(data):
    count = data.draw(st.integers(1, 6))
    timed = []
    for number in range(1, count + 1):
        edges, estimate = _item(number)
        timed += [(edge.stamp, edge) for edge in edges]
        # -300: before any edge of it is there; 700: after its reject time. None, once or twice.
        for delay in data.draw(st.lists(st.integers(-300, 700), max_size=2)):
            timed.append((estimate.t3 + delay * MILLISECOND, estimate))
    stage = RejectStage(PARAMETERS, BELT)

    verdicts = [verdict for _, verdict in _play(stage, timed)]

    assert sorted(v.t3 for v in verdicts) == [_item(n)[1].t3 for n in range(1, count + 1)]
    assert len({v.item_id for v in verdicts}) == count
    estimates = sum(isinstance(what, MassEstimate) for _, what in timed)
    assert estimates == stage.late_estimates + sum(v.estimate_id > 0 for v in verdicts)
    for verdict in verdicts:
        assert (verdict.decision is Decision.ACCEPT) == (verdict.estimate_id > 0)


@given(st.data())
def test_lost_edges_make_faults_but_neither_two_verdicts_of_an_item_nor_none(data):
    all_edges = [edge for number in range(1, 7) for edge in _item(number)[0]]
    lost = data.draw(st.sets(st.sampled_from(all_edges), max_size=6))
    edges = [edge for edge in all_edges if edge not in lost]
    assume(edges)
    # The segmenter finds its items by the same tracker.
    tracker = ItemTracker(5 * MILLISECOND, 2 * NANOSECONDS)
    items = [(edge.stamp, replace(item)) for edge in edges for item in tracker.add(edge)]
    end = edges[-1].stamp + 4 * NANOSECONDS
    items += [(end, replace(item)) for item in tracker.expire(end)]
    timed = [(edge.stamp, edge) for edge in edges]
    for done, item in items:
        reasons = tuple(reason.value for reason in item.faults)
        estimate = MassEstimate(
            item.item_id, item.t1, item.t2, item.t3, reasons, mass=0.15, line_speed=1.0
        )
        for delay in data.draw(st.lists(st.integers(0, 700), max_size=2)):
            timed.append((done + delay * MILLISECOND, estimate))
    stage = RejectStage(PARAMETERS, BELT)

    verdicts = [verdict for _, verdict in _play(stage, timed)]

    assert len(verdicts) == len(items)
    assert {(v.t1, v.t3) for v in verdicts} == {(item.t1, item.t3) for _, item in items}
    assert sorted(v.item_id for v in verdicts) == sorted(item.item_id for _, item in items)


def test_edges_that_the_stages_have_paired_differently_have_one_verdict_each():
    # Of a product taken off with its t3 not there and one behind it with its t1 lost the segmenter
    # knows by their length which is which; the reject stage does not.
    ms = MILLISECOND
    edges = [
        EyeEdge(1000 * ms, Eye.INFEED, True), EyeEdge(1100 * ms, Eye.INFEED, False),
        EyeEdge(2100 * ms, Eye.INFEED, False), EyeEdge(2200 * ms, Eye.OUTFEED, True),
        EyeEdge(2300 * ms, Eye.OUTFEED, False),
    ]  # fmt: skip
    estimates = [
        (2100 * ms, MassEstimate(1, 1000 * ms, 1100 * ms, None, reasons=('MissingEdge',))),
        (2200 * ms, MassEstimate(2, None, 2100 * ms, 2200 * ms, reasons=('MissingEdge',))),
    ]
    for delay in (0, 20 * ms, 300 * ms):
        late = [(when + delay, estimate) for when, estimate in estimates]
        stage = RejectStage(PARAMETERS, BELT)

        verdicts = _play(stage, [*((edge.stamp, edge) for edge in edges), *late])

        assert len(verdicts) == 2
        assert {verdict.decision for _, verdict in verdicts} == {Decision.FAULT}


def test_an_edge_that_comes_again_long_after_is_no_new_stream():
    stage = RejectStage(PARAMETERS, BELT)
    timed = _as_they_happen(5, 20 * MILLISECOND)
    again = next(edge for _, edge in timed if isinstance(edge, EyeEdge) and not edge.eye)
    newest = max(when for when, _ in timed)

    verdicts = _play(stage, [*timed, (newest + MILLISECOND, again)])

    assert len(verdicts) == 5

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every announced item has one verdict, with or without a mass, in any order of arrival."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    Item,
    MassEstimate,
    StreamState,
    StreamStatus,
)
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage

MILLISECOND = NANOSECONDS // 1000
BELT = 0.2  # m
# 0.5 m at 1 m/s: told 500 - 20 ms after t3, judged 50 ms before that.
PARAMETERS = RejectParameters(
    lower_limit=0.1, upper_limit=0.2, actuator_delay=0.02, verdict_margin=0.05
)
REJECT_TIME, DUE = 480 * MILLISECOND, 430 * MILLISECOND


class Passage:
    """Records of an item of 0.1 m at 1 m/s, numbered from 1, each with the time at which it comes.

    The segmenter announces it when it has fully entered, and 10 ms after t3.
    """

    def __init__(self, number, start=NANOSECONDS, pitch=660 * MILLISECOND):
        self.t1 = start + (number - 1) * pitch
        self.t2, self.t3, self.t4 = (self.t1 + k * 100 * MILLISECOND for k in (1, 2, 3))
        self.edges = [
            EyeEdge(self.t1, Eye.INFEED, True),
            EyeEdge(self.t2, Eye.INFEED, False),
            EyeEdge(self.t3, Eye.OUTFEED, True),
            EyeEdge(self.t4, Eye.OUTFEED, False),
        ]
        self.entered = Item(self.t1, 1, number, self.t1, line_speed=1.0)
        self.complete = replace(self.entered, t2=self.t2, t3=self.t3, complete=True)
        self.estimate = MassEstimate(
            number, self.t1, self.t2, self.t3, mass=0.15, std_dev=1e-4, line_speed=1.0
        )

    def eyes(self):
        """Return the edges when they happen."""
        return [(edge.stamp, edge) for edge in self.edges]

    def announced(self):
        """Return the two announcements."""
        return [(self.t2, self.entered), (self.t3 + 10 * MILLISECOND, self.complete)]

    def weighed(self, delay=20 * MILLISECOND):
        """Return the estimate, `delay` ns after t3."""
        return [(self.t3 + delay, self.estimate)]

    def all(self):
        """Return all records."""
        return [*self.eyes(), *self.announced(), *self.weighed()]


def _renumbered(item, number):
    """Return the records of an item under another number."""
    return [
        (when, what if isinstance(what, EyeEdge) else replace(what, item_id=number))
        for when, what in item.all()
    ]


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


def test_what_is_not_weighed_is_a_fault_in_time_and_the_items_after_it_are_weighed():
    timed = [each for number in (1, 4) for each in Passage(number).all()]
    for number in (2, 3):
        timed += [*Passage(number).eyes(), *Passage(number).announced()]

    verdicts = _play(RejectStage(PARAMETERS, BELT), timed)

    assert [v.item_id for _, v in verdicts] == [1, 2, 3, 4]
    assert [v.decision.name for _, v in verdicts] == ['ACCEPT', 'FAULT', 'FAULT', 'ACCEPT']
    assert [v.estimate_id for _, v in verdicts] == [1, 0, 0, 4]
    for when, verdict in verdicts:
        item = Passage(verdict.item_id)
        assert (verdict.t1, verdict.t3, verdict.late) == (item.t1, item.t3, False)
        assert verdict.reject_at == item.t3 + REJECT_TIME
        if verdict.estimate_id:
            assert when == item.t3 + 20 * MILLISECOND
            continue
        assert verdict.reasons == ('NoEstimate',)
        assert math.isnan(verdict.mass)
        assert DUE <= when - item.t3 <= DUE + 10 * MILLISECOND  # as often as time is looked at


def test_an_estimate_waits_for_the_announcement_of_its_item():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)

    assert stage.take(item.estimate) == []
    assert stage.take(item.entered) == []
    (verdict,) = stage.take(item.complete)

    assert (verdict.item_id, verdict.decision) == (1, Decision.ACCEPT)


def test_a_mass_of_what_was_never_announced_has_no_verdict():
    stage = RejectStage(PARAMETERS, BELT)

    assert _play(stage, Passage(7).weighed()) == []
    assert stage.early.unknown == 1
    assert [v.item_id for _, v in _play(stage, Passage(3).all())] == [3]


def test_without_time_every_mass_is_waited_for_and_nothing_else_is_judged():
    stage = RejectStage(PARAMETERS, BELT)
    items = [Passage(number) for number in range(1, 4)]
    for item in items:
        for what in (*item.edges, item.entered, item.complete):
            assert stage.take(what) == []

    stage.take(StreamStatus(items[-1].t3 + 9 * NANOSECONDS, 0, StreamState.RUNNING))
    verdicts = [verdict for item in items for verdict in stage.take(item.estimate)]

    assert [(v.decision, v.late) for v in verdicts] == [(Decision.ACCEPT, False)] * 3


def test_a_verdict_after_its_reject_time_says_so():
    stage, item = RejectStage(replace(PARAMETERS, verdict_margin=0.0), BELT), Passage(1)
    for when, what in sorted([*item.eyes(), *item.announced()], key=lambda each: each[0]):
        stage.take(what, when)
    # The clock was not read: the process had no processor time.
    (verdict,) = stage.take(item.estimate, item.t3 + REJECT_TIME + 1)

    assert verdict.late


def test_time_runs_from_the_arrival_of_t3_however_fast_the_stamps_come():
    stage = RejectStage(PARAMETERS, BELT)
    verdicts = []
    for number in range(1, 11):  # 6.6 s of stamps in 10 ms
        for what in (*Passage(number).edges, Passage(number).entered, Passage(number).complete):
            verdicts += stage.take(what, number * MILLISECOND)

    assert verdicts == []
    assert stage.due == MILLISECOND + DUE


def test_an_item_that_was_given_up_is_a_fault_after_a_while():
    item = Passage(1)
    given_up = replace(item.complete, t3=None, reasons=('MissingEdge',))

    ((when, verdict),) = _play(RejectStage(PARAMETERS, BELT), [(item.t3, given_up)])

    assert verdict.reasons == ('MissingEdge', 'NoEstimate')
    assert (verdict.t1, verdict.t3) == (item.t1, None)
    assert 0 <= when - item.t3 - NANOSECONDS <= 10 * MILLISECOND


# The watch for a segmenter that is dead or behind.


def test_an_item_that_leaves_without_the_segmenter_is_a_fault_in_time():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)

    ((when, verdict),) = _play(stage, [*item.eyes(), (item.t2, item.entered)])
    assert (verdict.item_id, verdict.t1, verdict.t3) == (1, item.t1, item.t3)
    assert (verdict.decision, verdict.reasons) == (Decision.FAULT, ('NoEstimate',))
    assert verdict.reject_at == item.t3 + REJECT_TIME
    assert DUE <= when - item.t3 <= DUE + 10 * MILLISECOND
    assert not verdict.late


def test_a_later_announcement_of_an_item_that_had_its_fault_gets_no_verdict():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)
    again = replace(item.complete, item_id=1000)  # by a segmenter that was started again
    timed = [*item.eyes(), (item.t2, item.entered), (item.t3 + NANOSECONDS, item.complete)]
    timed += [(item.t3 + NANOSECONDS, replace(again, complete=False))]
    timed += [(item.t3 + NANOSECONDS, again), *item.weighed(2 * NANOSECONDS)]

    assert [v.item_id for _, v in _play(stage, timed)] == [1]
    assert (stage.late_items, stage.late_estimates) == (2, 1)


def test_items_that_were_never_announced_have_the_numbers_up_to_the_next_thousand():
    stage = RejectStage(PARAMETERS, BELT)
    timed = _renumbered(Passage(1), 997)
    for number in (2, 3, 4):
        timed += Passage(number).eyes()

    verdicts = _play(stage, timed)

    assert [v.item_id for _, v in verdicts] == [997, 998, 999]
    for when, verdict in verdicts[1:]:  # by the speed of the item before
        assert DUE <= when - verdict.t3 <= DUE + 10 * MILLISECOND
    assert stage.out_of_numbers


def test_an_edge_that_the_segmenter_has_taken_is_left_to_it():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)
    for when, what in [*item.eyes()[:2], (item.t2, item.entered), *item.eyes()[2:]]:
        assert stage.take(what, when) == []
    stage.take(StreamStatus(item.t4, 1, StreamState.RUNNING, 0, 4, last_edge=item.t4))

    assert stage.due is None


def test_before_a_segmenter_has_announced_anything_the_line_has_to_stop():
    stage = RejectStage(PARAMETERS, BELT)

    assert _play(stage, Passage(1).eyes()) == []
    assert stage.out_of_numbers


def test_an_announcement_with_a_number_that_another_item_has_stops_the_line():
    stage, other = RejectStage(PARAMETERS, BELT), Passage(2, start=3 * NANOSECONDS)
    timed = [*Passage(1).all(), *Passage(2).eyes()]  # the second one has no announcement

    verdicts = [verdict for _, verdict in _play(stage, [*timed, *other.all()])]

    assert [(v.item_id, v.reasons) for v in verdicts] == [(1, ()), (2, ('NoEstimate',))]
    assert stage.out_of_numbers


@pytest.mark.parametrize('judged', [[1, 2], [7, *range(5_000, 6_023)]])
def test_numbers_of_items_of_an_earlier_run_stop_the_line(judged):
    """A segmenter that has lost its numbers begins at 1; reject knows which it has judged."""
    stage = RejectStage(PARAMETERS, BELT, judged=judged)
    if judged[0] > 1:  # room for one more number, so that the smallest is forgotten
        _play(stage, Passage(1).all())

    assert _play(stage, Passage(2).all()) == []
    assert stage.out_of_numbers


def test_an_outfeed_eye_that_flickers_shows_one_item():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)
    stage.take(item.entered, item.t1)
    flicker = [
        (item.t4 + MILLISECOND, EyeEdge(item.t4 + MILLISECOND, Eye.OUTFEED, True)),
        (item.t4 + 2 * MILLISECOND, EyeEdge(item.t4 + 2 * MILLISECOND, Eye.OUTFEED, False)),
    ]

    assert len(_play(stage, [*item.eyes(), *flicker])) == 1
    assert not stage.out_of_numbers


def test_an_item_before_one_that_leaves_has_no_segmenter_any_more():
    stage, taken_off, item = RejectStage(PARAMETERS, BELT), Passage(1), Passage(2)
    timed = [*taken_off.eyes()[:2], (taken_off.t2, taken_off.entered)]
    timed += _renumbered(item, 1000)

    verdicts = [verdict for _, verdict in _play(stage, timed)]

    assert [(v.item_id, v.reasons) for v in verdicts] == [(1, ('NoEstimate',)), (1000, ())]


def test_a_segmenter_started_with_an_item_on_the_belt_makes_no_two_of_it():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)
    seen = replace(item.complete, item_id=1000, t1=None, t2=None, reasons=('MissingEdge',))
    timed = [*item.eyes(), (item.t2, item.entered), (item.t3, replace(seen, complete=False))]
    timed += [(item.t3 + MILLISECOND, seen)]

    ((_, verdict),) = _play(stage, timed)

    assert (verdict.item_id, verdict.t1, verdict.t3) == (1, item.t1, item.t3)
    assert verdict.decision is Decision.FAULT
    assert stage.late_items == 1


def test_a_stage_that_takes_the_place_of_another_judges_what_has_no_verdict():
    items = [Passage(number) for number in (1, 2, 3)]
    stage = RejectStage(PARAMETERS, BELT, judged=[1])

    verdicts = []
    for item in items:  # latched
        verdicts += stage.take(item.entered, 0) + stage.take(item.complete, 0)
    assert verdicts == []
    verdicts = [*stage.take(items[2].estimate, 0), *stage.advance(NANOSECONDS)]

    assert [(v.item_id, v.reasons) for v in verdicts] == [(3, ()), (2, ('NoEstimate',))]


def test_a_stage_that_was_started_again_waits_for_what_is_latched():
    item, following = Passage(1), Passage(2)
    stage = RejectStage(PARAMETERS, BELT, judged=[0, 7])
    latched = item.t3 + 2 * NANOSECONDS
    timed = [*item.eyes(), *following.eyes()]
    for _, what in (*item.announced(), *following.announced()):
        timed.append((latched, replace(what, item_id=what.item_id + 7)))

    verdicts = [verdict for _, verdict in _play(stage, timed)]

    assert [(v.item_id, v.t1) for v in verdicts] == [(8, item.t1), (9, following.t1)]
    assert not stage.out_of_numbers


def test_what_left_while_both_were_dead_has_a_number_before_the_next_thousand():
    stage = RejectStage(PARAMETERS, BELT, judged=[57])
    timed = Passage(1).eyes()
    timed += _renumbered(Passage(2), 1000)

    verdicts = [verdict for _, verdict in _play(stage, timed)]

    expected = [(58, Passage(1).t3), (1000, Passage(2).t3)]
    assert sorted((v.item_id, v.t3) for v in verdicts) == expected


def test_a_stage_that_stops_judges_all_that_is_announced():
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)
    stage.take(item.entered, item.t2)

    (verdict,) = stage.stop(item.t2)

    assert (verdict.item_id, verdict.decision) == (1, Decision.FAULT)
    assert (stage.take(item.complete, item.t3), stage.late_items) == ([], 1)


@given(st.data())
def test_every_item_has_exactly_one_verdict_in_any_order_of_arrival(data):
    count = data.draw(st.integers(1, 6))
    timed = []
    for item in map(Passage, range(1, count + 1)):
        timed += item.eyes()
        # The segmenter is in time, behind, or dead before t3; -300 is before any edge is there.
        first = item.entered.item_id == 1  # before it nothing could have a number
        late = 0 if first else data.draw(st.sampled_from([0, 100, 600, 1500])) * MILLISECOND
        alive = first or data.draw(st.booleans())
        timed += [(when + late, what) for when, what in item.announced()[: 1 + alive]]
        for delay in data.draw(st.lists(st.integers(-300, 700), max_size=2)):
            timed.append((item.t3 + delay * MILLISECOND, item.estimate))
    verdicts = [verdict for _, verdict in _play(RejectStage(PARAMETERS, BELT), timed)]

    assert sorted(v.t3 for v in verdicts) == [Passage(n).t3 for n in range(1, count + 1)]
    assert len({v.item_id for v in verdicts}) == count
    for verdict in verdicts:
        assert (verdict.decision is Decision.ACCEPT) == (verdict.estimate_id > 0)


@pytest.mark.parametrize('number', [2**63, 2**64 - 1])
def test_a_large_number_is_one_as_well(number):
    stage, item = RejectStage(PARAMETERS, BELT), Passage(1)
    for what in (item.entered, item.complete):
        stage.take(replace(what, item_id=number))

    (verdict,) = stage.take(replace(item.estimate, item_id=number))

    assert verdict.item_id == number


def test_no_mass_is_known_of_items_while_a_stranger_publishes():
    stage = RejectStage(PARAMETERS, BELT)
    verdicts = []
    for item in map(Passage, (1, 2, 3)):
        stage.foreign = item.complete.item_id == 2
        for what in (item.entered, item.complete, item.estimate):
            verdicts += stage.take(what)

    assert [v.reasons for v in verdicts] == [(), ('ForeignPublisher',), ()]
    assert math.isnan(verdicts[1].mass)

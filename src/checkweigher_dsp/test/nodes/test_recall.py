# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A reject stage that takes the place of another: each item has one verdict from the two."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_dsp.records import NANOSECONDS, Decision, Eye, EyeEdge, LineHistory, MassEstimate
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage

MILLISECOND = NANOSECONDS // 1000
BELT = 0.2  # m
PARAMETERS = RejectParameters()  # 0.5 m at 1 m/s, judged 50 ms before that
STEPS = ((0, Eye.INFEED, True), (100, Eye.INFEED, False), (200, Eye.OUTFEED, True),
         (300, Eye.OUTFEED, False))  # fmt: skip


def _items(count, pitch=250):
    """Edges and estimates of items of 0.1 m at 1 m/s, every `pitch` ms, all in order of time."""
    timed = []
    for number in range(1, count + 1):
        t1 = NANOSECONDS + number * pitch * MILLISECOND
        edges = [EyeEdge(t1 + ms * MILLISECOND, eye, blocked) for ms, eye, blocked in STEPS]
        estimate = MassEstimate(
            number, t1, edges[1].stamp, edges[2].stamp, mass=0.15, std_dev=1e-4, line_speed=1.0
        )
        timed += [(edge.stamp, edge) for edge in edges]
        timed.append((edges[2].stamp + 20 * MILLISECOND, estimate))
    return sorted(timed, key=lambda each: each[0])


def _give(stage, what, when):
    return stage.take(what, when)


def _history(timed, until, verdicts, limit=400):
    edges = [what for when, what in timed if isinstance(what, EyeEdge) and when < until]
    return LineHistory(
        1, until, max(0, len(edges) - limit), tuple(edges[-limit:]), tuple(verdicts[-200:])
    )


def _over(stage, now):
    return [v for step in range(300) for v in stage.advance(now + step * 10 * MILLISECOND)]


@given(
    killed=st.integers(0, 4000),
    dead=st.integers(0, 2500),
    answer=st.integers(0, 1500),
    pitch=st.sampled_from([210, 250, 400, 660]),
    timed_out=st.booleans(),
    limit=st.sampled_from([400, 17]),
    kept_back=st.booleans(),
)
def test_one_verdict_an_item_over_both_lives(
    killed, dead, answer, pitch, timed_out, limit, kept_back
):
    timed = _items(12, pitch)
    kill = NANOSECONDS + killed * MILLISECOND
    back = kill + dead * MILLISECOND  # the new stage begins to hear
    answer = min(answer, 200) if kept_back else answer
    asked = back + answer * MILLISECOND // 2  # the driver answers
    recalled = back + answer * MILLISECOND
    clock = (lambda when: when) if timed_out else (lambda when: None)
    first, second = RejectStage(PARAMETERS, BELT), RejectStage(PARAMETERS, BELT)
    early = [v for when, what in timed if when < kill for v in _give(first, what, clock(when))]

    kept = [(when, what) for when, what in timed if back <= when < recalled]
    late = []
    if not kept_back:  # the answer was too long in coming
        late += [v for when, what in kept for v in _give(second, what, clock(when))]
        kept = []
    live = [(what, clock(when)) for when, what in kept if isinstance(what, EyeEdge)]
    history = _history(timed, asked, [*early, *late], limit)
    late += second.recall(history, live, clock(recalled))
    masses = [(recalled, what) for _, what in kept if isinstance(what, MassEstimate)]
    masses += [(when, what) for when, what in timed if when >= recalled]
    late += [v for when, what in masses for v in _give(second, what, clock(when))]
    end = timed[-1][0]
    late += _over(second, end) if timed_out else second.stop()

    starts = [v.t1 for v in (*early, *late)]
    assert len(starts) == len(set(starts))
    assert len({v.item_id for v in (*early, *late)}) == len(starts)
    wanted = {what.t1 for _, what in timed if isinstance(what, MassEstimate)}
    if limit == 17 and set(starts) != wanted:
        # Then only what had passed both eyes before the history begins is without one.
        cut = history.edges[0].stamp
        assert all(t1 < cut for t1 in wanted - set(starts))
    else:
        assert set(starts) == wanted
    for verdict in late:
        if kept_back and verdict.t3 >= back:  # it was still on the belt
            assert verdict.decision is Decision.ACCEPT


def test_what_passed_while_nobody_judged_is_a_fault_at_once_and_late_where_it_is():
    timed = _items(4, 660)
    edges = tuple(what for _, what in timed if isinstance(what, EyeEdge))
    now = edges[11].stamp  # the third is just leaving
    stage = RejectStage(PARAMETERS, BELT)

    verdicts = stage.recall(LineHistory(1, now, 0, edges[:12]), now=7 * NANOSECONDS)

    assert [v.reasons for v in verdicts] == [('NoEstimate',)] * 3
    assert [v.late for v in verdicts] == [True, True, False]
    assert [v.t1 for v in verdicts] == [edges[0].stamp, edges[4].stamp, edges[8].stamp]


def test_numbers_go_on_above_those_of_the_stage_before():
    timed = _items(5, 660)
    edges = tuple(what for _, what in timed if isinstance(what, EyeEdge))
    estimates = [what for _, what in timed if isinstance(what, MassEstimate)]
    first = RejectStage(PARAMETERS, BELT)
    judged = [v for e in edges[:8] for v in first.add_edge(e)]
    judged += [v for number in (0, 1) for v in first.add_estimate(estimates[number])]
    stage = RejectStage(PARAMETERS, BELT)

    (missed,) = stage.recall(LineHistory(1, edges[11].stamp, 0, edges[:12], tuple(judged)))
    for edge in edges[12:]:
        stage.add_edge(edge)
    weighed = [v for e in estimates[3:] for v in stage.add_estimate(e)]

    assert (missed.item_id, missed.t1) == (3, edges[8].stamp)
    assert [(v.item_id, v.estimate_id) for v in weighed] == [(4, 4), (5, 5)]


def test_what_is_judged_before_the_answer_comes_does_not_push_up_the_numbers_of_what_was_missed():
    timed = _items(5, 660)
    edges = tuple(what for _, what in timed if isinstance(what, EyeEdge))
    estimates = [what for _, what in timed if isinstance(what, MassEstimate)]
    stage = RejectStage(PARAMETERS, BELT)
    assert [v for edge in edges[16:] for v in stage.add_edge(edge)] == []
    (judged,) = stage.add_estimate(estimates[4])

    missed = stage.recall(LineHistory(1, edges[-1].stamp, 0, edges))

    assert [judged.item_id, *(v.item_id for v in missed)] == [5, 1, 2, 3, 4]


def test_an_estimate_that_comes_after_the_verdict_of_the_stage_before_changes_nothing():
    timed = _items(1)
    edges = tuple(what for _, what in timed if isinstance(what, EyeEdge))
    estimate = next(what for _, what in timed if isinstance(what, MassEstimate))
    first = RejectStage(PARAMETERS, BELT)
    for edge in edges:
        first.add_edge(edge, edge.stamp)
    (fault,) = first.advance(edges[2].stamp + NANOSECONDS)
    stage = RejectStage(PARAMETERS, BELT)

    assert stage.recall(LineHistory(1, edges[3].stamp, 0, edges, (fault,)), now=0) == []
    assert stage.add_estimate(estimate) == []
    assert stage.late_estimates == 1


@pytest.mark.parametrize('number', [0, 2**64 - 1])
def test_a_number_that_nobody_counted_is_not_gone_on_from(number):
    timed = _items(2, 660)
    edges = tuple(what for _, what in timed if isinstance(what, EyeEdge))
    (_, odd) = (v for v in _verdicts_on(timed))
    stage = RejectStage(PARAMETERS, BELT)

    verdicts = stage.recall(
        LineHistory(1, edges[-1].stamp, 0, edges, (replace(odd, item_id=number),))
    )

    assert [v.item_id for v in verdicts] == [1, 2]


def _verdicts_on(timed):
    stage = RejectStage(PARAMETERS, BELT)
    return [v for when, what in timed for v in _give(stage, what, when)]


def test_stopping_gives_a_fault_to_all_that_the_eyes_have_shown():
    timed = _items(3)
    stage = RejectStage(PARAMETERS, BELT)
    edges = [what for _, what in timed if isinstance(what, EyeEdge)]
    for edge in edges[:9]:  # the first has gone, the second is leaving, the third enters
        stage.add_edge(edge, edge.stamp)

    verdicts = stage.stop(edges[8].stamp)

    assert sorted(v.item_id for v in verdicts) == [1, 2, 3]
    assert {v.reasons for v in verdicts} == {('NoEstimate',)}
    assert stage.stop(edges[8].stamp) == []


def test_a_verdict_tells_what_the_eyes_know_where_the_estimate_lacks_it():
    timed = _items(1)
    edges = [what for _, what in timed if isinstance(what, EyeEdge)]
    estimate = next(what for _, what in timed if isinstance(what, MassEstimate))
    stage = RejectStage(PARAMETERS, BELT)
    for edge in edges:
        stage.add_edge(edge)

    fault = replace(estimate, t1=None, line_speed=math.nan, reasons=('StartUp',), mass=math.nan)
    (verdict,) = stage.add_estimate(fault)

    assert (verdict.t1, verdict.t3) == (edges[0].stamp, edges[2].stamp)
    assert verdict.reject_at == edges[2].stamp + NANOSECONDS // 2  # 0.5 m at 1 m/s

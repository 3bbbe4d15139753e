# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""When the reject node has heard all that it has missed, and when it asks the driver again."""

from checkweigher_dsp.nodes.recall import Recall
from checkweigher_dsp.records import Eye, EyeEdge, LineHistory

BELT = 0.2  # m


def edges_until(last: int) -> tuple[EyeEdge, ...]:
    return tuple(EyeEdge(stamp, Eye.INFEED, bool(stamp % 2)) for stamp in range(1, last + 1))


def history_until(last: int) -> LineHistory:
    return LineHistory(1, last, 0, edges_until(last))


def is_over(recall: Recall) -> bool:
    return recall.is_over(BELT, driver=True, status=True, edges=True)


def asked() -> Recall:
    recall = Recall()
    recall.hear_driver(ended=False)
    assert recall.may_ask
    assert not recall.ask()
    assert not recall.may_ask
    return recall


def hear(recall: Recall, stamp: int) -> None:
    recall.edges.append((edges_until(stamp)[-1], None))


def test_an_answer_that_holds_the_first_edge_that_came_is_all():
    recall = asked()
    hear(recall, 8)
    assert not is_over(recall)
    recall.answer(history_until(9), has_first=False)
    assert not recall.may_ask
    assert is_over(recall)


def test_after_an_edge_beyond_the_answer_the_driver_is_asked_once_more_for_those_between():
    recall = asked()
    recall.answer(history_until(4), has_first=False)
    hear(recall, 8)
    assert not is_over(recall)
    assert recall.may_ask
    assert recall.ask()
    assert not recall.may_ask
    assert not is_over(recall)
    recall.answer(history_until(8), has_first=True)
    assert is_over(recall)
    assert recall.history == history_until(8)
    assert not recall.may_ask


def test_answers_to_questions_before_the_first_edge_came_are_not_the_last_however_many():
    recall = asked()
    hear(recall, 8)
    for _ in range(3):
        recall.answer(history_until(4), has_first=False)
        assert not is_over(recall)
        assert recall.may_ask
    assert recall.ask()
    recall.answer(history_until(9), has_first=True)
    recall.answer(history_until(4), has_first=False)  # has been long on its way
    assert recall.history == history_until(9)
    assert is_over(recall)


def test_an_edge_that_no_answer_tells_of_is_waited_for_no_longer():
    recall = asked()
    recall.answer(history_until(4), has_first=False)
    hear(recall, 8)
    recall.answer(history_until(6), has_first=recall.ask())
    assert not recall.may_ask
    assert is_over(recall)

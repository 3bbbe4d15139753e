# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts that do not come are noticed; holes in a product and flicker are no products."""

from checkweigher_core.records import Decision, Eye, EyeEdge, Verdict
from checkweigher_driver.line_io.rejector.verdict_watch import VerdictWatch

MS = 1_000_000
IN, OUT = Eye.INFEED, Eye.OUTFEED


def feed(watch, *edges):
    for time, eye, blocked in edges:
        watch.edge(EyeEdge(time * MS, eye, blocked), time * MS)


def answer(watch, t3, travel=500):
    watch.verdict(Verdict(1, t3 * MS, Decision.ACCEPT, reject_at=(t3 + travel) * MS))


def test_it_is_overdue_when_the_product_before_had_to_be_rejected():
    watch = VerdictWatch(0)
    feed(watch, (0, OUT, True))
    assert not watch.is_overdue(1000 * MS)
    answer(watch, 0, travel=300)
    feed(watch, (100, OUT, False), (2000, OUT, True))
    assert not watch.is_overdue(2300 * MS)
    assert watch.is_overdue(2301 * MS)
    assert not watch.is_overdue(2400 * MS)  # said once


def test_the_first_product_has_a_second_and_a_given_time_holds_always():
    first, given = VerdictWatch(0), VerdictWatch(200 * MS)
    for watch in (first, given):
        feed(watch, (0, OUT, True))
    assert [first.is_overdue(at * MS) for at in (1000, 1001)] == [False, True]
    assert [given.is_overdue(at * MS) for at in (200, 201)] == [False, True]


def test_a_hole_in_a_product_and_a_flicker_behind_it_ask_for_no_verdict():
    watch = VerdictWatch(0)
    feed(watch, (0, IN, True), (100, IN, False), (200, OUT, True))
    answer(watch, 200)
    # A hole that the infeed eye did not see, then the trailing edge that is seen twice.
    feed(watch, (240, OUT, False), (270, OUT, True), (301, OUT, False), (305, OUT, True))
    assert not watch.is_overdue(9000 * MS)
    feed(watch, (400, OUT, True))
    assert watch.is_overdue(9000 * MS)


def test_what_was_asked_before_a_pause_is_not_asked_after_it():
    watch = VerdictWatch(0)
    feed(watch, (0, OUT, True))
    watch.clear()
    assert not watch.is_overdue(9000 * MS)

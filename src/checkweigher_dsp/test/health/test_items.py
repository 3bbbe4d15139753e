# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is told of items that fail, of masses that are uncertain, and of verdicts that are late."""

from dataclasses import replace

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.records import NANOSECONDS, Decision, MassEstimate, StopRequest, Verdict
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_dsp.health.items import (
    ConvergenceWatch,
    FaultWatch,
    RejectorWatch,
    VerdictTiming,
    WorkloadWatch,
)


def test_faults_are_an_error_once_nothing_else_comes():
    watch = FaultWatch()
    for _ in range(48):
        watch.add(0.0, ())
    watch.add(0.0, ('MissingEdge',))
    assert watch.finding(0.0).level == Level.OK
    watch.add(0.0, ('MissingEdge', 'LateEdge'))
    watch.add(0.0, ('DistanceFault',))
    finding = watch.finding(0.0)
    assert (finding.level, finding.hint) == (Level.WARN, Reason.MISSING_EDGE.hint)
    assert finding.values['LateEdge'] == 1
    for _ in range(2):
        watch.add(0.0, ('MissingEdge',))
    assert watch.finding(0.0).text == 'the last 5 items were faults, mostly MissingEdge'
    assert watch.finding(0.0).level == Level.ERROR
    watch.add(0.0, ())
    assert watch.finding(0.0).level == Level.WARN
    assert watch.finding(601.0).level == Level.OK
    assert watch.finding(601.0).values['items'] == 54
    for _ in range(5):
        watch.add(602.0, ('of another make',))
    assert 'docs/reasons.md' in watch.finding(602.0).hint


def test_a_stage_that_is_always_busy_is_warned_of():
    watch = WorkloadWatch()
    for number in range(20):
        watch.add(0.5 * number - 0.3, 0.5 * number)
    finding = watch.finding(9.9)
    assert finding.values['busy_share'] == pytest.approx(0.6, rel=1e-12)
    assert finding.level == Level.WARN
    assert watch.finding(16.0).level == Level.OK


def estimate(number=1, mass=0.1, std_dev=1e-4, frequency=36.0, damping=0.06, reasons=()):
    return MassEstimate(
        number, 0, 1, 2, reasons, mass, std_dev, natural_frequency=frequency, damping_ratio=damping
    )


def test_uncertain_masses_and_a_changed_platform_are_warned_of():
    watch = ConvergenceWatch()
    for second in range(40):
        watch.add(second, estimate())
    finding = watch.finding(40.0, 0.25)
    assert finding.level == Level.OK
    assert finding.values['relative_std_dev_percent'] == pytest.approx(0.1, rel=1e-12)
    for second in range(40, 50):
        watch.add(second, estimate(frequency=27.0))
    finding = watch.finding(50.0, 0.25)
    assert finding.level == Level.WARN
    assert finding.text == 'the platform oscillates at 27.0 Hz, usually at 36.0 Hz'
    for second in range(50, 60):
        watch.add(second, estimate(std_dev=0.02))
    certain = 'the masses have a relative standard deviation of 20.0 %'
    assert watch.finding(60.0, 0.25).text == certain
    assert watch.finding(60.0, 0.5).level == Level.OK


def test_a_platform_that_does_not_swing_has_no_frequency():
    watch = ConvergenceWatch()
    for second in range(100):
        watch.add(second, estimate(frequency=100.0 if second < 80 else 1000.0, damping=0.97))
    assert watch.finding(100.0, 0.25).level == Level.OK


def test_estimates_that_do_not_converge_are_told_with_the_hint_of_their_reason():
    watch = ConvergenceWatch()
    for second in range(5):
        watch.add(second, estimate(reasons=('SpeedNotTrained',)))
    finding = watch.finding(5.0, 0.25)
    assert (finding.level, finding.hint) == (Level.ERROR, Reason.SPEED_NOT_TRAINED.hint)


def verdict(number, *, reject_after=0.5, late=False, estimate_id=None):
    t3 = number * NANOSECONDS
    reject_at = t3 + round(reject_after * NANOSECONDS)
    known = {'late': late, 'estimate_id': number if estimate_id is None else estimate_id}
    return Verdict(number, t3, Decision.ACCEPT, reject_at=reject_at, **known)


def test_latency_and_margin_count_from_the_arrival_of_the_outfeed_edge():
    watch = VerdictTiming()
    for number, taken in ((1, 0.004), (2, 0.002), (3, 0.1)):
        watch.add_edge(50.0 + number, number * NANOSECONDS)
        watch.add(50.0 + number + taken, verdict(number))
    finding = watch.verdicts(54.0, 0.05, deadlines=True)
    assert finding.level == Level.OK
    assert finding.values['latency_median_ms'] == pytest.approx(4.0, abs=1e-6)
    assert finding.values['latency_max_ms'] == pytest.approx(100.0, abs=1e-6)
    assert finding.values['least_margin_ms'] == pytest.approx(400.0, abs=1e-6)
    assert watch.verdicts(54.0, 0.45, deadlines=True).level == Level.WARN
    assert watch.verdicts(54.0, 0.45, deadlines=False).level == Level.OK
    assert watch.verdicts(114.0, 0.45, deadlines=True).level == Level.OK


def test_a_late_verdict_is_an_error_for_a_minute():
    watch = VerdictTiming()
    watch.add(1.0, verdict(1, late=True))
    assert watch.verdicts(2.0, 0.05, deadlines=True).level == Level.ERROR
    assert watch.verdicts(62.0, 0.05, deadlines=True).level == Level.OK


def test_many_items_in_a_row_beyond_a_limit_are_told():
    watch = VerdictTiming()
    for number in range(1, 10):
        watch.add(number, replace(verdict(number), decision=Decision.OVER))
    assert watch.verdicts(9.0, 0.05, deadlines=True).level == Level.OK
    watch.add(10.0, replace(verdict(10), decision=Decision.OVER))
    finding = watch.verdicts(10.0, 0.05, deadlines=True)
    assert (finding.level, finding.text) == (Level.WARN, 'the last 10 items were OVER')
    watch.add(11.0, verdict(11))
    assert watch.verdicts(11.0, 0.05, deadlines=True).level == Level.OK


def test_items_without_a_mass_name_the_stage_that_is_missing():
    watch = VerdictTiming()
    watch.add(0.0, verdict(1))
    assert watch.line(0.0, '').level == Level.OK
    assert watch.line(0.0, 'identifier').hint == 'identifier does not run: start it'
    for number in (2, 3, 4):
        assert watch.line(0.0, '').level < Level.ERROR
        watch.add(0.0, verdict(number, estimate_id=0))
    assert watch.line(0.0, '').text == 'no mass of the last 3 items has arrived'


def test_the_rejector_is_told_of_with_what_to_do():
    watch = RejectorWatch()
    assert watch.finding(0.0, None, confirmed=True).level == Level.OK
    watch.add_strays(1.0, 2)
    finding = watch.finding(2.0, None, confirmed=True)
    assert (finding.level, finding.values['reject_eye_strays']) == (Level.WARN, 2)
    assert watch.finding(62.0, None, confirmed=True).level == Level.OK
    finding = watch.finding(62.0, StopRequest(StopReason.TOO_MANY_REJECTS, 7), confirmed=True)
    assert finding.level == Level.ERROR
    assert finding.text == 'stop requested: TooManyRejects at item 7'
    assert finding.hint.endswith('; then reset the stop')

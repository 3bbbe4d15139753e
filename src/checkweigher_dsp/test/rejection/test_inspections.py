# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejects by other inspection devices, in the reject stage: one verdict an item, never changed."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    ExternalReject,
    Eye,
    EyeEdge,
    Item,
    MassEstimate,
    ProductOnLine,
    Verdict,
)
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage

MS = NANOSECONDS // 1000
START = 1000 * NANOSECONDS
LENGTH = 0.5  # m, between the eyes
# At 1 m/s: an item of 0.1 m blocks an eye for 100 ms and is 500 ms from eye to eye.
BEHIND = RejectParameters(  # the device stands 0.6 m behind the infeed eye
    lower_limit=0.1,
    upper_limit=0.2,
    rejector_distance=1.0,
    verdict_margin=0.05,
    inspections='metal',
    inspection_distances=(0.6,),
    inspection_times=(0.1,),
    inspection_tolerance=0.01,
)
BEFORE = replace(BEHIND, inspection_distances=(-0.4,))


def item_at(ms: int, number: int = 1, *, complete: bool = True) -> Item:
    """Return an announcement of an item that entered at `ms`."""
    t1, t2, t3 = (START + (ms + each) * MS for each in (0, 100, 500))
    return Item(t1, 1, number, t1, t2, t3 if complete else None, 1.0, complete)


def estimate_at(ms: int, number: int = 1, mass: float = 0.15) -> MassEstimate:
    """Return the mass of an item that entered at `ms`."""
    t1, t2, t3 = (START + (ms + each) * MS for each in (0, 100, 500))
    return MassEstimate(number, t1, t2, t3, (), mass, 1e-4, belt_speed=1.0, line_speed=1.0)


class Line:
    """A reject stage whose records come 5 ms after their stamps, and the verdicts it has given."""

    def __init__(self, parameters: RejectParameters) -> None:
        self.stage = RejectStage(parameters, LENGTH)
        self.stage.inspections.set_running(True, 0)
        self.verdicts: list[Verdict] = []

    def at(self, ms: int) -> int:
        return START + (ms + 5) * MS

    def edge(self, ms: int, eye: Eye, blocked: bool) -> None:
        edge = EyeEdge(START + ms * MS, eye, blocked)
        self.verdicts += self.stage.take(edge, self.at(ms))

    def item(self, ms: int, mass: float = 0.15, number: int = 1) -> None:
        """Let an item that enters at `ms` pass both eyes, and be weighed 20 ms later."""
        for when in (0, 100, 500, 520):
            self.part(ms, when, mass, number)

    def part(self, ms: int, when: int, mass: float = 0.15, number: int = 1) -> None:
        """Let an item that entered at `ms` have its edge after `when`, ms, or its mass."""
        if when < 520:
            self.edge(ms + when, Eye.OUTFEED if when == 500 else Eye.INFEED, when != 100)
        if when in (100, 500):
            item = item_at(ms, number, complete=when == 500)
            self.verdicts += self.stage.take(item, self.at(ms + when))
        if when == 520:
            self.verdicts += self.stage.take(estimate_at(ms, number, mass), self.at(ms + when))

    def reject(self, ms: int, late: int = 5, device: str = 'metal', number: int = 0) -> None:
        said = ExternalReject(START + ms * MS, device, number)
        self.stage.inspections.add(said, LENGTH, START + (ms + late) * MS)

    def wait(self, ms: int) -> None:
        self.verdicts += self.stage.advance(self.at(ms))

    def verdict(self, ms: int = 3000) -> Verdict:
        """Return the only verdict until `ms`."""
        self.wait(ms)
        (verdict,) = self.verdicts
        return verdict

    @property
    def missed(self) -> tuple[int, str] | None:
        request = self.stage.inspections.missed
        return request and (request.item_id, request.text)


def test_a_verdict_waits_until_the_device_has_answered():
    line = Line(BEHIND)
    line.item(0)
    assert line.verdicts == []  # the item is at the device from 600 to 700 ms

    line.wait(809)  # 700 ms, 100 ms to answer and 10 ms by which that may be off
    assert line.verdicts == []
    verdict = line.verdict(810)
    assert (verdict.decision, verdict.reasons, verdict.late) == (Decision.ACCEPT, (), False)


@pytest.mark.parametrize('ms', [590, 650, 810])
def test_what_the_device_rejects_is_a_fault_that_keeps_its_mass(ms: int):
    line = Line(BEHIND)
    line.item(0)
    line.reject(ms)

    verdict = line.verdict()
    assert (verdict.decision, verdict.reasons) == (Decision.FAULT, ('MetalDetected',))
    assert verdict.mass == 0.15
    assert verdict.batch_accepted == 0
    assert line.missed is None


def test_a_device_before_the_weigh_belt_rejects_an_item_that_the_eyes_show_later():
    line = Line(BEFORE)
    line.reject(-350)  # at the device from -400 to -300 ms
    line.item(0)
    assert [each.reasons for each in line.verdicts] == [('MetalDetected',)]  # nothing to wait for


@pytest.mark.parametrize('ms', [589, 811])
def test_a_reject_outside_the_time_of_the_item_is_not_its_own_and_stops_the_line(ms: int):
    line = Line(BEHIND)
    line.item(0)
    line.reject(ms)
    line.wait(900)

    assert line.verdict(60_000).decision is Decision.ACCEPT
    assert line.missed == (0, 'metal: no item was at the device')


@pytest.mark.parametrize(
    ('mass', 'decision', 'missed'),
    [
        (0.15, Decision.ACCEPT, (1, 'metal: the item was already accepted')),
        (0.3, Decision.OVER, None),  # rejected anyway
    ],
)
def test_a_reject_that_comes_after_the_verdict_stops_the_line_and_changes_nothing(
    mass: float, decision: Decision, missed: tuple[int, str] | None
):
    line = Line(BEHIND)
    line.item(0, mass=mass)
    line.wait(815)
    line.reject(650, late=170)

    assert line.verdict().decision is decision
    assert line.missed == missed


def test_an_item_whose_rejector_cannot_wait_for_the_device_is_not_inspected():
    line = Line(replace(BEHIND, rejector_distance=0.2))
    line.item(0)  # at the rejector at 700 ms, verdict at 650 ms; the device answers until 820 ms
    line.wait(649)
    assert line.verdicts == []
    verdict = line.verdict(650)
    assert (verdict.decision, verdict.reasons) == (Decision.FAULT, ('NotInspected',))
    assert not verdict.late


def test_what_passes_while_a_device_does_not_run_is_not_inspected():
    line = Line(BEHIND)
    line.item(0)
    line.stage.inspections.set_running(False, START + 700 * MS)
    line.stage.inspections.set_running(True, START + 900 * MS)
    line.item(1000, number=2)
    line.wait(3000)

    assert [each.reasons for each in line.verdicts] == [('NotInspected',), ()]


def test_nothing_is_accepted_until_the_devices_are_known_to_run():
    line = Line(BEHIND)
    line.stage = RejectStage(BEHIND, LENGTH)
    line.item(0)
    assert line.verdict().reasons == ('NotInspected',)


def test_a_device_that_names_its_item_needs_no_place():
    line = Line(BEHIND)
    line.item(0, number=7)
    line.reject(0, device='vision', number=7)
    assert line.verdict(900).reasons == ('VisionRejected',)


def test_a_stamp_from_a_device_without_a_place_stops_the_line():
    line = Line(BEHIND)
    line.reject(650, device='xray')
    assert line.missed == (0, 'xray: the device is not in reject.inspections')


def test_two_items_that_a_reject_fits_are_both_rejected():
    line = Line(BEHIND)
    parts = [(ms, part) for ms in (0, 120) for part in (0, 100, 500, 520)]
    for ms, part in sorted(parts, key=sum):
        line.part(ms, part, number=1 + (ms > 0))
    line.reject(750)  # within 600 to 800 and 720 to 920 ms
    line.wait(3000)

    assert [each.reasons for each in line.verdicts] == 2 * [('MetalDetected',)]


def test_an_item_without_a_mass_is_one_fault_with_or_without_a_reject():
    line = Line(BEHIND)
    for when in (0, 100, 500):
        line.part(0, when)
    line.reject(650)
    assert line.verdict().reasons == ('NoEstimate', 'MetalDetected')
    assert line.missed is None


def test_a_mass_that_comes_again_while_the_device_has_yet_to_answer_changes_nothing():
    line = Line(BEHIND)
    line.item(0)
    line.verdicts += line.stage.take(estimate_at(0, mass=0.5), line.at(530))
    assert line.verdict().mass == 0.15
    assert line.stage.late_estimates == 1


def test_without_deadlines_the_verdict_is_by_mass_alone():
    stage = RejectStage(BEHIND, LENGTH)
    assert stage.take(item_at(0)) == []
    (verdict,) = stage.take(estimate_at(0))
    assert verdict.decision is Decision.ACCEPT


def test_a_pass_of_a_performance_test_without_a_mass_says_so():
    stage = RejectStage(RejectParameters(), LENGTH)
    stage.product = ProductOnLine(1, performance_test=True)
    stage.take(item_at(0), START + 500 * MS)
    (verdict,) = stage.advance(START + 3000 * MS)
    assert verdict.reasons == ('PerformanceTest', 'NoEstimate')


def test_a_stop_leaves_no_item_without_its_verdict_and_accepts_nothing():
    line = Line(BEHIND)
    line.item(0)
    (verdict,) = line.stage.stop(line.at(530))
    assert verdict.reasons == ('NotInspected',)


def test_random_lines_give_each_item_one_verdict_and_no_rejected_item_is_accepted():
    random = np.random.default_rng(17)
    for trial in range(200):
        parameters = (BEHIND, BEFORE)[trial % 2]
        device = parameters.inspection_distances[0]
        line = Line(parameters)
        entered = np.cumsum(random.integers(700, 1500, 8)).tolist()
        bad = set(random.choice(8, random.integers(0, 4), replace=False).tolist())
        events = []
        for number, ms in enumerate(entered):
            events += [(ms + when, 1, number, when) for when in (0, 100, 500, 520)]
            if number in bad:
                at = ms + round(1000 * device) + int(random.integers(0, 190))
                events.append((at, 0, 0, 0))
        for when, kind, number, part in sorted(events):
            line.wait(when)
            if kind == 1:
                line.part(entered[number], part, number=number + 1)
            else:
                line.reject(when)
        line.wait(entered[-1] + 60_000)

        assert sorted(each.item_id for each in line.verdicts) == list(range(1, 9))
        rejected = {each.item_id - 1 for each in line.verdicts if each.decision is Decision.FAULT}
        assert rejected == bad, trial

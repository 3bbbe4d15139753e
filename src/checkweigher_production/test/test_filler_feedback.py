# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The controller of the filler against steps worked by hand, and in a loop with its delay."""

from dataclasses import replace
import math

import numpy as np
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Decision, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_production.filler_feedback import FillerController, FillerParameters

CONTENTS, TARE = 0.15, 0.004


def item(number: int, contents: float) -> Verdict:
    decision = Decision.FAULT if math.isnan(contents) else Decision.ACCEPT
    return Verdict(number, number * 10**9, decision, mass=contents + TARE)


def steps(controller: FillerController, contents: list[float]) -> list[tuple[float, float, bool]]:
    made = [controller.add(item(number, mass)) for number, mass in enumerate(contents, 1)]
    return [(each.step, each.correction, each.limited) for each in made if each]


def test_the_steps_are_those_of_an_integral_controller_with_its_limits():
    known = FillerParameters(
        subgroup=3, delay=2, gain=0.5, dead_band=0.0005, max_step=0.002, max_correction=0.003
    )
    controller = FillerController(known, 'crisps', CONTENTS, TARE)
    first = None
    for number, contents in enumerate([0.147, math.nan, 0.148, 0.1], 1):
        first = controller.add(item(number, contents)) or first
    # The median 147 g is 3 g below the target; half of that, and the fault is no part of it.
    assert (first.item_id, first.items, first.stamp) == (4, 3, 4 * 10**9)
    assert first.product == 'crisps'
    assert (first.target, first.median) == pytest.approx((0.15, 0.147), abs=1e-12)
    assert (first.step, first.correction) == pytest.approx((0.0015, 0.0015), abs=1e-12)
    # Two on their way; a step that is limited by itself, then by the sum of all; the dead band.
    assert steps(controller, [0.1, 0.1] + [0.1] * 3 + [math.nan] * 2 + [0.1504] * 3) == [
        (pytest.approx(0.0015, abs=1e-12), pytest.approx(0.003, abs=1e-12), True),
        (0.0, pytest.approx(0.003, abs=1e-12), False),
    ]
    assert steps(controller, [0.160] * 3) == [
        (pytest.approx(-0.002, abs=1e-12), pytest.approx(0.001, abs=1e-12), True)
    ]


def test_faults_that_have_a_mass_and_test_products_move_nothing():
    known = FillerParameters(subgroup=2, delay=2, max_correction=0.02)
    controller = FillerController(known, 'crisps', CONTENTS, TARE)
    metal = replace(item(1, 0.1), decision=Decision.FAULT, reasons=('MetalDetected',))
    of_test = replace(
        item(2, 0.1), decision=Decision.UNDER, reasons=(Reason.PERFORMANCE_TEST.value,)
    )
    assert not any(controller.add(each) for each in [metal, metal, of_test, of_test])
    # The median of the two others alone: 148 g is 2 g below.
    assert steps(controller, [0.148]) == []
    assert controller.add(metal) is None
    assert steps(controller, [0.148]) == [
        (pytest.approx(0.001, abs=1e-12), pytest.approx(0.001, abs=1e-12), False)
    ]
    # Two are on their way then; a fault is one of them, and a test product was in no filler.
    assert controller.add(metal) is None
    assert not any(controller.add(of_test) for _ in range(5))
    assert steps(controller, [0.1, 0.150, 0.150])[0][0] == 0


def test_a_drift_is_followed_and_the_delay_makes_nothing_swing():
    """A ramp of r an item and an integral controller: it lags by r (subgroup + delay) / gain."""
    drift, delay = -2e-6, 12
    known = FillerParameters(subgroup=10, delay=delay, gain=0.5, max_correction=0.05)
    controller = FillerController(known, 'crisps', CONTENTS, TARE)
    on_the_way = [CONTENTS] * delay
    made, contents = [], []
    for number in range(1, 3001):
        on_the_way.append(CONTENTS + drift * number + controller.correction)
        contents.append(on_the_way.pop(0))
        if found := controller.add(item(number, contents[-1])):
            made.append(found.step)
    period = 10 + delay
    settled = np.array(contents[1000:]) - CONTENTS
    assert np.mean(made[50:]) == pytest.approx(-drift * period, rel=1e-2)
    assert settled.mean() == pytest.approx(drift * period / 0.5, rel=0.5)
    assert np.abs(settled).max() < 3 * abs(drift) * period / 0.5
    assert abs(contents[-1] - drift * 3000 - CONTENTS) > 0.005  # without it: 6 g too light


def test_a_correction_goes_on_after_a_restart_within_its_limit():
    known = FillerParameters(max_correction=0.003)
    for before, after in ((0.002, 0.002), (0.02, 0.003)):
        controller = FillerController(known, 'crisps', CONTENTS, TARE, before)
        assert controller.correction == after


@pytest.mark.parametrize('limit', [0.0, math.inf])
def test_a_controller_without_a_limit_is_refused(limit: float):
    with pytest.raises(ParameterError, match=r'filler\.max_correction'):
        FillerParameters(max_correction=limit)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts: limits, faults and the time at the rejector."""

from dataclasses import replace
import math

import numpy as np
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Decision, MassEstimate, ProductOnLine
from checkweigher_dsp.rejection import limits
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage

LIMITS = RejectParameters(lower_limit=0.1, upper_limit=0.2)


def _estimate(mass=0.15, **fields):
    values = {'belt_speed': 1.25, 'line_speed': 1.25, 'std_dev': 1e-4, **fields}
    return MassEstimate(5, 0, 100_000_000, 200_000_000, mass=mass, **values)


def judge(estimate, parameters):
    return limits.judge(estimate, parameters, parameters.limits)


@pytest.mark.parametrize(
    ('mass', 'decision', 'parameters'),
    [
        (0.15, Decision.ACCEPT, LIMITS),
        (0.1, Decision.ACCEPT, LIMITS),
        (0.2, Decision.ACCEPT, LIMITS),
        (math.nextafter(0.1, 0), Decision.UNDER, LIMITS),
        (math.nextafter(0.2, 1), Decision.OVER, LIMITS),
        (-0.5, Decision.UNDER, LIMITS),
        (math.nan, Decision.FAULT, LIMITS),
        *[(mass, Decision.ACCEPT, RejectParameters()) for mass in (1e-6, 0.15, 1e3)],
        (0.0, Decision.ACCEPT, RejectParameters(lower_limit=0.0, upper_limit=0.0)),
    ],
)
def test_both_limits_belong_to_what_is_accepted(mass, decision, parameters):
    assert judge(_estimate(mass), parameters).decision is decision


GUARDED = replace(LIMITS, guard_risk=0.02)  # of 0.1 mg: 0.2054 mg at each limit


@pytest.mark.parametrize(
    ('mass', 'decision', 'reasons'),
    [
        (0.1002, Decision.UNDER, ('GuardBand',)),
        (0.1003, Decision.ACCEPT, ()),
        (0.1997, Decision.ACCEPT, ()),
        (0.1998, Decision.OVER, ('GuardBand',)),
        (0.0999, Decision.UNDER, ()),
    ],
)
def test_a_guard_band_is_as_wide_as_the_stated_deviation_asks(mass, decision, reasons):
    verdict = judge(_estimate(mass), GUARDED)
    assert (verdict.decision, verdict.reasons) == (decision, reasons)
    assert (verdict.lower_limit, verdict.upper_limit) == (0.1, 0.2)


@pytest.mark.parametrize(
    ('mean', 'spread', 'share'),
    [
        *(
            pytest.param(*filler, None, marks=pytest.mark.soak)
            for filler in ((0.15, 0.003), (0.1445, 0.0015), (0.1425, 0.0015))
        ),
        (0.1432 - 1e-9, 0, 0.02),
    ],
)
def test_of_the_items_outside_no_more_are_accepted_than_the_risk_says(mean, spread, share):
    """Weigh items of a filler, each on a machine of its own, and print what the guard band costs.

    The worst case are items just below the limit: of these, the share that is accepted is the risk.
    """
    rng = np.random.default_rng(1)
    count, plain = 100_000, RejectParameters(lower_limit=0.1432, upper_limit=0.16)
    guarded = replace(plain, guard_risk=0.02)
    std_dev = 1.5e-4 * np.exp(0.5 * rng.normal(size=count))
    masses = mean + spread * rng.normal(size=count)
    seen = masses + std_dev * rng.normal(size=count)
    outside = (masses < plain.lower_limit) | (masses > plain.upper_limit)

    def count_wrong(parameters):
        accepted = [
            judge(_estimate(mass, std_dev=each), parameters).decision is Decision.ACCEPT
            for mass, each in zip(seen, std_dev, strict=True)
        ]
        return np.sum(outside & accepted), np.sum(~outside & ~np.array(accepted))

    (plain_accepts, plain_rejects), (accepts, rejects) = map(count_wrong, (plain, guarded))
    print(
        f'{mean:.4f} kg: {outside.sum()} outside, accepted {plain_accepts}, {accepts}; '
        f'{count - outside.sum()} within, rejected {plain_rejects}, {rejects}'
    )
    risk = guarded.guard_risk
    allowed = 4 * math.sqrt(risk * (1 - risk) * outside.sum())
    assert accepts <= risk * outside.sum() + allowed
    assert share is None or accepts == pytest.approx(share * count, abs=allowed)


def test_what_has_a_reason_is_a_fault_even_with_a_mass_within_the_limits():
    for estimate in (_estimate(), _estimate(math.nan, belt_speed=math.nan)):
        reasons = ('Saturation', 'SamplesLost')
        verdict = judge(replace(estimate, reasons=reasons), replace(LIMITS, min_speed=0.5))

        # Not that of its length or speed, which is no more known.
        assert (verdict.decision, verdict.reasons) == (Decision.FAULT, reasons)


def test_the_verdict_says_what_it_rests_on():
    verdict = judge(_estimate(0.15), LIMITS)

    assert (verdict.item_id, verdict.t3) == (5, 200_000_000)
    assert (verdict.mass, verdict.std_dev) == (0.15, 1e-4)
    assert (verdict.lower_limit, verdict.upper_limit) == (0.1, 0.2)


@pytest.mark.parametrize(
    ('distance', 'delay', 'speed', 'reject_at'),
    [
        (0.0, 0.0, 1.25, 200_000_000),
        (0.5, 0.0, 1.25, 600_000_000),  # 0.4 s on the way
        (0.5, 0.12, 1.25, 480_000_000),
        (0.5, 0.0, 0.5, 1_200_000_000),
        (0.5, 0.0, math.nan, None),
        (0.5, 0.0, 0.0, None),
        (0.5, 0.0, -1.0, None),
    ],
)
def test_the_rejector_is_told_after_the_way_of_the_item_less_its_delay(
    distance, delay, speed, reject_at
):
    parameters = RejectParameters(rejector_distance=distance, actuator_delay=delay)
    # The speed of the line, for faults have none of their own.
    estimate = _estimate(line_speed=speed, belt_speed=math.nan)

    assert judge(estimate, parameters).reject_at == reject_at
    assert judge(replace(estimate, t3=None), parameters).reject_at is None


RANGES = RejectParameters(
    lower_limit=0.1, min_length=0.08, max_length=0.12, min_speed=0.5, max_speed=1.5
)


@pytest.mark.parametrize(
    ('length', 'speed', 'reasons'),
    [
        (0.1, 1.0, ()),
        (0.08, 0.5, ()),
        (0.12, 1.5, ()),
        (math.nextafter(0.08, 0), 1.0, ('ProductTooShort',)),
        (math.nextafter(0.12, 1), 1.0, ('ProductTooLong',)),
        (0.1, math.nextafter(0.5, 0), ('BeltSpeed',)),
        (0.1, math.nextafter(1.5, 2), ('BeltSpeed',)),
        (0.2, 2.0, ('ProductTooLong', 'BeltSpeed')),
        (math.nan, 1.0, ('BadWindow',)),
        (0.1, math.nan, ('BeltSpeed',)),
    ],
)
def test_a_product_of_another_length_or_speed_is_a_fault(length, speed, reasons):
    verdict = judge(_estimate(product_length=length, belt_speed=speed), RANGES)

    assert verdict.decision is (Decision.FAULT if reasons else Decision.ACCEPT)
    assert verdict.reasons == reasons
    assert verdict.mass == 0.15


@pytest.mark.parametrize(
    ('of_line', 'reasons'),
    [
        (ProductOnLine(1, needed=True), ('NoProduct',)),
        (RejectParameters(needs_product=True).limits, ('NoProduct',)),  # before the first product
        (ProductOnLine(1, 'crisps', needed=True), ()),
        (ProductOnLine(1), ()),
    ],
)
def test_where_a_product_is_needed_nothing_is_accepted_without_one(of_line, reasons):
    verdict = limits.judge(_estimate(), RejectParameters(), of_line)

    assert verdict.reasons == reasons
    assert verdict.decision is (Decision.FAULT if reasons else Decision.ACCEPT)


def test_the_product_on_the_line_replaces_all_limits_of_the_parameters():
    stage = RejectStage(RANGES)
    assert stage.product == RANGES.limits
    stage.product = nuts = ProductOnLine(1, 'nuts', needed=True, upper_limit=0.12)
    stage.parameters = LIMITS
    assert stage.product is nuts
    verdict = limits.judge(_estimate(0.05), stage.parameters, stage.product)
    assert (verdict.decision, verdict.lower_limit) == (Decision.ACCEPT, -math.inf)


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('lower_limit', (math.nan, -0.1, math.inf, 0.3, '0.1')),
        ('upper_limit', (math.nan, -0.1, -math.inf)),
        ('min_length', (0.2,)),
        ('max_length', (math.nan,)),
        ('min_speed', (-0.1, 1.6)),
        ('rejector_distance', (-1.0, math.nan, math.inf)),
    ],
)
def test_limits_that_cannot_be_are_refused_by_name(name, values):
    for value in values:
        with pytest.raises(ParameterError, match=rf'^reject\.{name}: '):
            replace(RANGES, **{'upper_limit': 0.2, name: value})


@pytest.mark.parametrize(
    ('mass', 'std_dev'),
    [
        *[(mass, 1e-4) for mass in (math.inf, -math.inf, math.nan)],
        *[(0.15, std_dev) for std_dev in (math.nan, math.inf, -math.inf, -1.0, 1e300, 0.151)],
    ],
)
def test_a_mass_without_a_usable_deviation_is_a_fault_even_without_limits(mass, std_dev):
    verdict = judge(_estimate(mass, std_dev=std_dev), RejectParameters())

    assert (verdict.decision, verdict.reasons) == (Decision.FAULT, ('NoConvergence',))
    assert verdict.mass == pytest.approx(mass, nan_ok=True)

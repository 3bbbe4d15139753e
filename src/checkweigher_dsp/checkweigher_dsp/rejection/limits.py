# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on masses according to the limits of the product."""

from dataclasses import replace
import math

from checkweigher_core.records import Decision, Item, MassEstimate, ProductOnLine, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.rejection.parameters import RejectParameters

# Largest standard deviation in kg that is plausible for any mass. A larger standard deviation is
# plausible if it does not exceed the mass.
_NOISE = 1e-3


def judge(estimate: MassEstimate, parameters: RejectParameters, product: ProductOnLine) -> Verdict:
    """Return the verdict on an estimate by the limits of the product.

    An item without a mass is a FAULT. An item with a mass is a FAULT if its length or speed is
    outside the limits, or if its standard deviation is implausible. An item is also a FAULT if a
    required product is not selected, and during a performance test. An item that only the guard
    band rejects (JCGM 106:2012, 8.3) has the reason GuardBand.
    """
    reasons = estimate.reasons or tuple(why.value for why in objections(estimate, product))
    # Add the reason PerformanceTest even without a mass, because the pass counts in the test.
    if product.performance_test:
        reasons = (Reason.PERFORMANCE_TEST.value, *reasons)
    low, high = product.lower_limit, product.upper_limit
    decision = Decision.FAULT if reasons else decide(estimate.mass, low, high)
    if decision is Decision.ACCEPT:
        guard = parameters.guard_factor * estimate.std_dev
        decision = decide(estimate.mass, low + guard, high - guard)
        reasons = () if decision is Decision.ACCEPT else (Reason.GUARD_BAND.value,)
    return Verdict(
        estimate.item_id,
        estimate.t3,
        decision,
        reasons,
        estimate.mass,
        estimate.std_dev,
        low,
        high,
        parameters.reject_time(estimate.t3, estimate.line_speed),
        estimate.t1,
        estimate_id=estimate.item_id,
    )


def without_estimate(item: Item, reject_at: int | None, product: ProductOnLine) -> Verdict:
    """Return the FAULT of an item whose mass has not arrived in time. `reject_at` is in ns."""
    test = (Reason.PERFORMANCE_TEST.value,) if product.performance_test else ()
    return Verdict(
        item.item_id,
        item.t3,
        Decision.FAULT,
        tuple(dict.fromkeys((*test, *item.reasons, Reason.NO_ESTIMATE.value))),
        lower_limit=product.lower_limit,
        upper_limit=product.upper_limit,
        reject_at=reject_at,
        t1=item.t1,
    )


def refused(verdict: Verdict) -> Verdict:
    """Return a verdict changed to a FAULT without a mass.

    The first reason of the FAULT is ForeignPublisher, because a node outside the line publishes
    topics of the line.
    """
    reasons = tuple(dict.fromkeys((Reason.FOREIGN_PUBLISHER.value, *verdict.reasons)))
    return replace(
        verdict, decision=Decision.FAULT, reasons=reasons, mass=math.nan, std_dev=math.nan
    )


def objections(estimate: MassEstimate, limits: ProductOnLine) -> list[Reason]:
    """Return the reasons to reject a weighed item, apart from the limits of its mass."""
    length, largest = estimate.product_length, max(abs(estimate.mass), _NOISE)
    # `certain` is False if the mass or its standard deviation is NaN.
    certain = math.isfinite(estimate.mass) and 0 <= estimate.std_dev <= largest
    found = [] if certain else [Reason.NO_CONVERGENCE]
    if limits.lacks_product:
        found.append(Reason.NO_PRODUCT)
    if _outside(length, limits.min_length, limits.max_length):
        if math.isnan(length):
            found.append(Reason.BAD_WINDOW)
        elif length < limits.min_length:
            found.append(Reason.PRODUCT_TOO_SHORT)
        else:
            found.append(Reason.PRODUCT_TOO_LONG)
    if _outside(estimate.belt_speed, limits.min_speed, limits.max_speed):
        found.append(Reason.BELT_SPEED)
    return found


def tolerance(product: ProductOnLine) -> float:
    """Return the tolerance of a product in kg.

    The tolerance is half the accepted range of masses. With a nominal weight, the tolerance is at
    most the distance from the nominal weight to the lower limit. A missing limit counts as
    infinite. The tolerance is not less than 0.
    """
    allowed = (product.upper_limit - product.lower_limit) / 2
    below = product.nominal - product.lower_limit if product.nominal else math.inf
    return max(min(allowed, below), 0.0)


def _outside(value: float, low: float, high: float) -> bool:
    return (low > 0 or high < math.inf) and not low <= value <= high  # NaN is outside


def decide(mass: float, lower_limit: float, upper_limit: float) -> Decision:
    """Return the decision on a mass by the limits. A mass equal to a limit is accepted.

    The mass and the limits are in kg. The mass must not be NaN.
    """
    if mass < lower_limit:
        return Decision.UNDER
    return Decision.OVER if mass > upper_limit else Decision.ACCEPT

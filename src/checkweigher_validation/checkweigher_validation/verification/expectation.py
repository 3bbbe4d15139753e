# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Duration of a plan, and expected uncertainty of each result, compared with the error limit."""

from collections.abc import Callable, Iterator
import math
from typing import NamedTuple

from checkweigher_validation.verification.evaluation import COVERAGE, ZERO_ACCURACY
from checkweigher_validation.verification.plan import MINUTE, Plan
from checkweigher_validation.verification.steps import Step, StepKind, steps_of

_NO_ERROR = StepKind.OUTSIDE, StepKind.REPEATABILITY  # kinds of steps without a limit of the error


class Expected(NamedTuple):
    """Expected uncertainty of the error of a step, and the error limit, in kg."""

    step: Step
    uncertainty: float  # expanded uncertainty, k = 2
    limit: float

    @property
    def is_decidable(self) -> bool:
        """Whether an error of 0 would be within the limit despite its uncertainty."""
        return self.uncertainty <= self.limit


def expected_uncertainties(
    plan: Plan, std_dev: Callable[[float], float], zero: float = 0.0
) -> Iterator[Expected]:
    """Yield the expected uncertainty of each step with an error limit, except later zero readings.

    Steps with an error limit are the first zero reading and all steps with a load, except steps
    outside the range of dynamic setting and the test of repeatability. The uncertainty for a load
    combines the uncertainty of the reference mass and, for passes, the standard deviation of the
    mean error. `std_dev` returns the standard deviation in kg of the error of a single pass of a
    mass in kg, and `zero` is the standard deviation in kg of a zero that an operator sets. An
    unknown standard deviation is 0.
    """
    own = plan.accuracy_class
    for step in steps_of(plan):
        if step.kind is StepKind.ZEROING:
            yield Expected(step, COVERAGE * zero, ZERO_ACCURACY * own.interval)
        if step.load is None or step.kind in _NO_ERROR:
            continue
        mass = step.load.mass
        scatter = 0.0 if step.at_rest else std_dev(mass) / math.sqrt(step.count)
        limit = (own.max_static_error if step.at_rest else own.max_error)(mass)
        yield Expected(step, COVERAGE * math.hypot(scatter, step.load.uncertainty), limit)


def expected_duration(plan: Plan, spacing: float) -> float:
    """Return the duration of a plan in s, if the products enter the belt `spacing` m apart.

    The duration includes the waiting times of the warm-up. The time that a person needs to place a
    load, to change the belt speed, or to answer is not included.
    """
    time = 0.0
    for step in steps_of(plan):
        time = max(time, MINUTE * (step.minutes or 0.0))
        time += plan.rest.duration_s if step.speed is None else step.count * spacing / step.speed
    return time

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steps of a verification, in the order in which they are made, and what each asks for.

The order of the tests is that of the test report of OIML R 51-2:2006 (warm-up time, range of
dynamic setting, zero-setting and so on: its table of contents is what was at hand of it), but for
zero, which is read before anything is judged by it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from checkweigher_core.records import GRAMS
from checkweigher_validation.verification.plan import MINUTE, Mass, Passes, Plan


class StepKind(StrEnum):
    """Test that a step belongs to."""

    WARM_UP_ZERO = 'warm-up, zero'
    WARM_UP = 'warm-up, passes'
    ZEROING = 'zero, accuracy'
    ZERO = 'zero, stability'
    OUTSIDE = 'outside the range of dynamic setting'
    PASSES = 'passes'
    ECCENTRICITY = 'eccentricity'
    REPEATABILITY = 'repeatability'
    STATIC = 'static'
    ZERO_AFTER = 'zero after the loads'


# What the operator is asked to do before a step of a kind.
_TO_DO = {
    StepKind.WARM_UP_ZERO: 'Leave the belt empty',
    StepKind.WARM_UP: 'Run the belt at {speed:g} m/min and let {load} pass',
    StepKind.ZEROING: 'Leave the belt empty; it is zeroed',
    StepKind.ZERO: 'Leave the belt empty',
    StepKind.OUTSIDE: 'Run the belt at {speed:g} m/min and let {load} pass; each must be a FAULT',
    StepKind.PASSES: 'Run the belt at {speed:g} m/min and let {load} pass',
    StepKind.ECCENTRICITY: 'Run the belt at {speed:g} m/min and let {load} pass, lane {position}',
    StepKind.REPEATABILITY: 'Run the belt at {speed:g} m/min and let {load} pass',
    StepKind.STATIC: 'Stop the belt and put {load} on its middle',
    StepKind.ZERO_AFTER: 'Take off all loads and leave the belt empty',
}
# Kinds whose result is one reading of what rests on the belt, not passes.
AT_REST = (
    StepKind.WARM_UP_ZERO,
    StepKind.ZEROING,
    StepKind.ZERO,
    StepKind.STATIC,
    StepKind.ZERO_AFTER,
)


@dataclass(frozen=True, slots=True)
class Step:
    """A step: a reading at rest, or `count` passes of a load at a belt speed."""

    name: str
    kind: StepKind
    load: Mass | None = None
    speed: float | None = None  # m/s
    count: int = 0
    position: str = ''
    minutes: float | None = None  # after the first step, of the warm-up

    @property
    def at_rest(self) -> bool:
        """Whether it is a reading at rest."""
        return self.kind in AT_REST

    @property
    def to_do(self) -> str:
        """What the operator has to do."""
        load = f'{self.load.name} ({GRAMS * self.load.mass:g} g)' if self.load else ''
        speed = MINUTE * (self.speed or 0)
        return _TO_DO[self.kind].format(speed=speed, load=load, position=self.position)


def steps_of(plan: Plan) -> tuple[Step, ...]:
    """Return the steps of a plan in their order; no two have one name."""
    return tuple(_steps(plan))


def _steps(plan: Plan) -> Iterator[Step]:
    if plan.warm_up:
        for minutes in plan.warm_up.minutes:
            at = f'{minutes:g}'
            yield Step(f'warm_up_zero_{at}', StepKind.WARM_UP_ZERO, minutes=minutes)
            yield _of(f'warm_up_{at}', StepKind.WARM_UP, plan.warm_up.passes, minutes=minutes)
    for number in range(1, plan.zero_readings + 1):
        yield Step(f'zero_{number}', StepKind.ZEROING if number == 1 else StepKind.ZERO)
    for number, passes in enumerate(plan.outside, start=1):
        yield _of(f'outside_{number}', StepKind.OUTSIDE, passes)
    for passes in plan.passes:
        yield _of(f'passes_{MINUTE * passes.speed:g}_{passes.load.name}', StepKind.PASSES, passes)
    if plan.eccentricity:
        for position in plan.eccentricity.positions:
            name = f'eccentricity_{position}'
            yield _of(name, StepKind.ECCENTRICITY, plan.eccentricity.passes, position=position)
    if plan.repeatability:
        yield _of('repeatability', StepKind.REPEATABILITY, plan.repeatability)
    for load in plan.static:
        yield Step(f'static_up_{load.name}', StepKind.STATIC, load)
    for load in reversed(plan.static[:-1]):
        yield Step(f'static_down_{load.name}', StepKind.STATIC, load)
    if plan.zero_readings:
        yield Step('zero_after', StepKind.ZERO_AFTER)


def _of(
    name: str, kind: StepKind, passes: Passes, *, position: str = '', minutes: float | None = None
) -> Step:
    return Step(name, kind, passes.load, passes.speed, passes.count, position, minutes)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steps of a verification, with an instruction to the operator for each step.

The tests have the order of the test report in OIML R 51-2:2006, except that the test of the zero
precedes the tests that depend on the zero. Only the table of contents of R 51-2 was available.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

from checkweigher_validation.verification.plan import MINUTE, Mass, Plan


class StepKind(StrEnum):
    """Test, or part of a test, to which a step belongs."""

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


_PASS = '{belt}; once the step has begun, let {load} pass'
_BELT = 'Run the belt at {speed:g} m/min'
_NEW_SPEED = (
    f'{_BELT} and let one product pass, because the first one after a change of speed is a FAULT'
)
# Instruction to the operator for each kind of step, as a format string.
_TO_DO = {
    StepKind.WARM_UP_ZERO: 'Leave the belt empty',
    StepKind.WARM_UP: _PASS,
    StepKind.ZEROING: 'Leave the belt empty while the line is zeroed',
    StepKind.ZERO: 'Leave the belt empty',
    StepKind.OUTSIDE: f'{_PASS}; each of these passes must be a FAULT',
    StepKind.PASSES: _PASS,
    StepKind.ECCENTRICITY: f'{_PASS}, lane {{position}}',
    StepKind.REPEATABILITY: _PASS,
    StepKind.STATIC: 'Stop the belt and put {load} on its middle',
    StepKind.ZERO_AFTER: 'Take off all loads and leave the belt empty',
}


@dataclass(frozen=True, slots=True)
class Step:
    """Step of a verification: a reading at rest, or `count` passes of a load."""

    name: str
    kind: StepKind
    load: Mass | None = None
    speed: float | None = None  # belt speed in m/s, or None for a reading at rest
    count: int = 0  # planned number of passes, 0 for a reading at rest
    position: str = ''  # name of the position across the belt, empty except for eccentricity.
    # Planned time in min after the first step of the warm-up, or None in other tests.
    minutes: float | None = None
    # Whether the step has passes, and the previous passes had another belt speed or did not exist.
    is_new_speed: bool = False

    @property
    def at_rest(self) -> bool:
        """Whether the step is a reading at rest."""
        return self.speed is None

    @property
    def to_do(self) -> str:
        """Instruction to the operator, in one line without a full stop."""
        load = f'{self.load.name} ({self.load.mass_g:g} g)' if self.load else ''
        belt = (_NEW_SPEED if self.is_new_speed else _BELT).format(speed=MINUTE * (self.speed or 0))
        return _TO_DO[self.kind].format(belt=belt, load=load, position=self.position)


def steps_of(plan: Plan) -> tuple[Step, ...]:
    """Return the steps of a plan in chronological order. Each step has a unique name."""
    steps, speed = [], None
    for step in _steps(plan):
        steps.append(replace(step, is_new_speed=step.speed not in (None, speed)))
        speed = step.speed or speed
    return tuple(steps)


def _steps(plan: Plan) -> Iterator[Step]:
    if plan.warm_up:
        passes = plan.passes_of(plan.warm_up)
        for minutes in plan.warm_up.minutes:
            yield Step(f'warm_up_zero_{minutes:g}', StepKind.WARM_UP_ZERO, minutes=minutes)
            yield Step(f'warm_up_{minutes:g}', StepKind.WARM_UP, *passes, minutes=minutes)
    if plan.zero:
        yield Step('zero_1', StepKind.ZEROING)
        for number in range(2, plan.zero.readings + 1):
            yield Step(f'zero_{number}', StepKind.ZERO)
    for number, section in enumerate(plan.outside, start=1):
        yield Step(f'outside_{number}', StepKind.OUTSIDE, *plan.passes_of(section, default=3))
    for passes in plan.passes_in_motion:
        yield Step(f'passes_{MINUTE * passes.speed:g}_{passes.load.name}', StepKind.PASSES, *passes)
    if aside := plan.eccentricity:
        passes = plan.passes_of(aside)
        for position in aside.positions:
            yield Step(f'eccentricity_{position}', StepKind.ECCENTRICITY, *passes, position)
    if plan.repeatability:
        yield Step('repeatability', StepKind.REPEATABILITY, *plan.passes_of(plan.repeatability))
    yield from _steps_at_rest(plan)


def _steps_at_rest(plan: Plan) -> Iterator[Step]:
    for load in plan.static_loads:
        yield Step(f'static_up_{load.name}', StepKind.STATIC, load)
    for load in reversed(plan.static_loads[:-1]):
        yield Step(f'static_down_{load.name}', StepKind.STATIC, load)
    if plan.zero:
        yield Step('zero_after', StepKind.ZERO_AFTER)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Procedures of verifications whose readings are given in the test, g."""

from collections.abc import Sequence
import math

from checkweigher_core.records import LoadCell, ZeroChange
from checkweigher_validation.verification.plan import read_plan
from checkweigher_validation.verification.procedure import AtRest, Attempt, ItemPass, Procedure
from checkweigher_validation.verification.steps import steps_of

START = 1_780_000_000_000_000_000  # ns
CELL = LoadCell(960.0, 1e6, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2, 'made', 'LC-1')
IDENTITY = {
    'program': 'checkweigher 0', 'program_sha256': 64 * '1', 'parameters_sha256': 64 * '2',
    'audit_log': 'audit.log', 'audit_log_sha256': 64 * '4', 'audit_log_last_hash': 64 * '5',
    'how': 'by hand',
}  # fmt: skip
# A verification with few passes of two loads.
PLAN = """
machine: {type: CW-200, serial: CW-1}
load_cell: {serial: LC-1}
amplifier: {serial: AD-1}
class: XIII
e_g: 0.1
min_g: 60
max_g: 600
prepackages_g: [100]
operator: A. Tester
place: hall 3
environment: 21 degC
references:
  small: {mass_g: 74.5, uncertainty_g: 0.002, certificate: C-1, serial: W-1}
  middle: {mass_g: 194.5, uncertainty_g: 0.003, certificate: C-2, serial: W-2}
  large: {mass_g: 500.0, uncertainty_g: 0.005, certificate: C-3, serial: W-3}
speeds_m_per_min: [60]
loads: [small, middle]
passes: 3
warm_up: {minutes: [0, 1], load: middle, speed_m_per_min: 60, passes: 3}
zero: {readings: 2}
outside: [{load: middle, speed_m_per_min: 150}]
eccentricity: {positions: [left, right], load: middle, speed_m_per_min: 60, passes: 3}
repeatability: {load: middle, speed_m_per_min: 60, passes: 3}
rest: {duration_s: 1, tolerance_g: 0.1}
static: {loads: [small, large]}
"""

# Products 3 s apart: between two of them the belt is empty for long enough to be read. The line
# carries what the plan calls middle, so passes of small are far off. What may still move while the
# belt is read is small against the limit of the zero, 0.025 g.
GUIDED_LINE: dict[str, object] = {
    'simulator.profile': 'quiet', 'simulator.masses': [0.1945], 'simulator.count': 0,
    'simulator.spacing': 3.0, 'simulator.seed': 4, 'rate': 4.0,
}  # fmt: skip
SHORT_PLAN = (
    PLAN[: PLAN.index('outside:')].replace('loads: [small, middle]', 'loads: [middle, small]')
    .replace('passes: 3', 'passes: 2').replace('minutes: [0, 1]', 'minutes: [0, 0.02]')
    + 'rest: {duration_s: 0.5, tolerance_g: 0.02}\n'
)  # fmt: skip


def attempt_of(
    name: str, *, masses: Sequence[float] = (), std_devs: Sequence[float] | None = None,
    faults: int = 0, speed: float = 1.0, reading: float | None = None, begin: int = START,
    skipped: str = '',
) -> Attempt:  # fmt: skip
    """Return an attempt at a step of `PLAN` with masses or a reading in g."""
    step = next(step for step in steps_of(read_plan(PLAN)) if step.name == name)
    if reading is not None:
        return Attempt(step, begin, begin + 1, reading=AtRest(1e-3 * reading, 1e-6, 1e-5, 960))
    stated = [0.1] * len(masses) if std_devs is None else std_devs
    passes = [
        ItemPass(begin, 1e-3 * mass, 1e-3 * std_dev, speed, ())
        for mass, std_dev in zip(masses, stated, strict=True)
    ]
    passes += [ItemPass(begin, math.nan, math.nan, 1.0, ('Unknown',))] * faults
    return Attempt(step, begin, begin + 1, tuple(passes), skipped=skipped)


def procedure_of(
    *attempts: Attempt, zeros: Sequence[ZeroChange] = (), plan: str = PLAN,
    between: Sequence[ItemPass] = (),
) -> Procedure:  # fmt: skip
    """Return the procedure of some attempts, with the faults between them."""
    return Procedure(
        read_plan(plan), plan, IDENTITY, CELL, tuple(attempts), tuple(zeros), 64 * '3',
        tuple(between),
    )  # fmt: skip

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of a verification, in which an operator tests the line according to a plan."""

from dataclasses import dataclass
from enum import IntEnum

from checkweigher_core.records.quantities import Stamp


class StepState(IntEnum):
    """Kind of a `VerificationStep`: the plan, the machine identity, or the state of a step."""

    PLAN = 0
    IDENTITY = 1
    BEGUN = 2
    DONE = 3
    SKIPPED = 4


class ProgressState(IntEnum):
    """State of a guided verification.

    The state is IDLE if no verification is running, ASKING while a step waits to be performed or
    skipped, MAKING while the step is performed, and DECIDING after the step has failed.
    """

    IDLE = 0
    ASKING = 1
    MAKING = 2
    DECIDING = 3


class StepAnswer(IntEnum):
    """Answer of the operator: perform or repeat a step, skip it, or go on after a failed step."""

    MAKE = 0
    SKIP = 1
    GO_ON = 2


@dataclass(frozen=True, slots=True)
class VerificationStep:
    """Step of a verification, plan of a verification, or identity of the machine.

    `stamp` is the end of the step, or the stamp of the latest sample if the step has not ended.
    `step` is the name of the step, or empty for a plan or an identity. `begin` is the beginning of
    a step whose state is BEGUN or DONE; otherwise it is None. `text` is the plan as YAML, the
    identity as JSON, or the reason why a step was skipped; otherwise it is empty.
    """

    stamp: Stamp
    step: str
    state: StepState
    begin: Stamp | None = None
    text: str = ''


@dataclass(frozen=True, slots=True)
class VerificationProgress:
    """Progress of a guided verification at `stamp` (system clock), with the present question.

    `question` is the number of the question, which the answer must repeat. `folder` is the path of
    the machine folder with the plans and the reports, and `name` is the name of the present or last
    verification in this folder. `results` contains one line for each of the `steps`, which is empty
    until the step has been performed. `step` is the index of the present step, from 0, and `lines`
    contains the zeros and passes of this step so far. `text` is the instruction or the progress of
    the step or, if no verification is running, the result of the last verification.
    """

    stamp: Stamp
    state: ProgressState
    question: int = 0
    folder: str = ''
    name: str = ''
    steps: tuple[str, ...] = ()
    results: tuple[str, ...] = ()
    step: int = 0
    text: str = ''
    lines: tuple[str, ...] = ()

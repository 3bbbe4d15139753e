# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of a verification."""

from dataclasses import dataclass
from enum import IntEnum

from checkweigher_core.records.quantities import Stamp


class StepState(IntEnum):
    """Subject of a `VerificationStep`: the plan, the identity of the machine, or a step."""

    PLAN = 0
    IDENTITY = 1
    BEGUN = 2
    DONE = 3
    SKIPPED = 4


class ProgressState(IntEnum):
    """State of a guided verification."""

    IDLE = 0
    ASKING = 1
    MAKING = 2
    DECIDING = 3


class StepAnswer(IntEnum):
    """Answer of the operator: make the step (again), skip it, or go on after a failure."""

    MAKE = 0
    SKIP = 1
    GO_ON = 2


@dataclass(frozen=True, slots=True)
class VerificationStep:
    """Step of a verification, its plan, or the identity of the machine.

    `stamp` is the end of the step, or the time of the latest sample if the step has not ended.
    `text` is the plan, the identity as JSON, or the reason why a step was skipped.
    """

    stamp: Stamp
    step: str
    state: StepState
    begin: Stamp | None = None
    text: str = ''


@dataclass(frozen=True, slots=True)
class VerificationProgress:
    """Progress of a guided verification at `stamp`, and its question to the operator.

    `question` is the number of the question. `folder` has the plans of the machine and its
    verifications by name. `results` has a line for each of `steps`, empty before the step is made.
    `step` is the index of the present step, and `lines` are its results so far.
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

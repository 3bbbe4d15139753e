# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of a verification."""

from dataclasses import dataclass
from enum import IntEnum

from checkweigher_core.records.quantities import Stamp


class StepState(IntEnum):
    """Content of a `VerificationStep`: the plan, the identity of the machine, or the step state."""

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
    """Answer of the operator: perform or repeat a step, skip it, or go on after a failed step."""

    MAKE = 0
    SKIP = 1
    GO_ON = 2


@dataclass(frozen=True, slots=True)
class VerificationStep:
    """Step of a verification, plan of a verification, or identity of the machine.

    `stamp` is the end of the step, or the stamp of the latest sample if the step has not ended.
    `text` is the plan, the identity as JSON, or the reason why a step was skipped.
    """

    stamp: Stamp
    step: str
    state: StepState
    begin: Stamp | None = None
    text: str = ''


@dataclass(frozen=True, slots=True)
class VerificationProgress:
    """Progress of a guided verification at `stamp` (system clock), with the present question.

    An answer must repeat the number `question`. `folder` contains the plans and the reports.
    `results` contains one line for each of the `steps`, empty before the step is performed. `step`
    is the index of the present step, and `lines` are its results so far.
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

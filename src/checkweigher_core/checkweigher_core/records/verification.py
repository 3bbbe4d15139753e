# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of a verification."""

from dataclasses import dataclass
from enum import IntEnum

from checkweigher_core.records.quantities import Stamp


class StepState(IntEnum):
    """What a record of a verification tells of: the plan, what is verified, or a step."""

    PLAN = 0
    IDENTITY = 1
    BEGUN = 2
    DONE = 3
    SKIPPED = 4


class ProgressState(IntEnum):
    """Whether a guided verification waits for an answer of the operator, and for which."""

    IDLE = 0
    ASKING = 1
    MAKING = 2
    DECIDING = 3


class StepAnswer(IntEnum):
    """What an operator answers: make the step, also again, skip it, or leave it as it failed."""

    MAKE = 0
    SKIP = 1
    GO_ON = 2


@dataclass(frozen=True, slots=True)
class VerificationStep:
    """A step of a verification, or its plan, or what it is a verification of.

    `stamp` is the end of the step in ns, or that of the latest sample where it has not ended;
    `text` is the plan, the identity as JSON, or why a step was skipped.
    """

    stamp: Stamp
    step: str
    state: StepState
    begin: Stamp | None = None
    text: str = ''


@dataclass(frozen=True, slots=True)
class VerificationProgress:
    """How far a guided verification is at `stamp`, ns, and what it asks the operator.

    `question` is the number of what is asked. In `folder` are the plans of the machine and, by
    their names, its verifications. `results` has a line for each of `steps`, empty before it is
    made; `step` is the place of the one that is asked for or made, and `lines` what came in it.
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

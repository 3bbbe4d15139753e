# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records that the stages exchange.

The records are frozen dataclasses, in one module for each subject. Stamps are integers in ns, so
that no stage rounds them. A stamp is on the clock of the samples unless its docstring names the
system clock. An unknown stamp is None, and an unknown number is NaN.
`checkweigher_core.ros.conversion` converts between records and messages.
"""

from checkweigher_core.records.equality import NanEqual
from checkweigher_core.records.machine import (
    ExternalReject,
    Eye,
    EyeEdge,
    LoadCell,
    MachineConditions,
    Reference,
    SampleBlock,
    StreamState,
    StreamStatus,
)
from checkweigher_core.records.newer import newer_fields
from checkweigher_core.records.production import (
    Alarm,
    Alarms,
    BatchResult,
    FillerFeedback,
    PerformanceState,
    PerformanceTest,
    ProductOnLine,
    Statistics,
)
from checkweigher_core.records.quantities import (
    GRAMS,
    MAX_MASS,
    MAX_SAMPLE_RATE,
    MAX_WINDOW,
    NANOSECONDS,
    NUMBERS_AT_ONCE,
    Stamp,
    local_time,
    seconds,
    utc,
)
from checkweigher_core.records.rejection import Decision, Permission, StopRequest, Verdict
from checkweigher_core.records.verification import (
    ProgressState,
    StepAnswer,
    StepState,
    VerificationProgress,
    VerificationStep,
)
from checkweigher_core.records.weighing import Item, MassEstimate, WeighWindow, ZeroChange

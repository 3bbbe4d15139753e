# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the reject stage."""

from dataclasses import dataclass
from enum import IntEnum
import math

from checkweigher_core.records.quantities import Stamp
from checkweigher_core.records.reasons import StopReason


class Decision(IntEnum):
    """What is to become of an item. All but ACCEPT are rejected."""

    FAULT = 0
    ACCEPT = 1
    UNDER = 2
    OVER = 3


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is to become of one item; masses and limits in kg.

    `item_id` is that of the estimate, or without one the reject stage's own count. No two verdicts
    share a number, so it is that count too where a restarted segmenter begins at 1 again;
    `estimate_id` is that of the estimate in any case, 0 without one. The rejector has to be told
    at `reject_at` (ns); a verdict is `late` if it came after that. The counts of `batch` and the
    `batch_surplus`, kg, are those of `BatchTally`, with this item. `station` counts from 1, 0 is
    the rejector, or of an accepted item none; it has to be told at `station_at`, ns.
    """

    item_id: int
    t3: Stamp | None
    decision: Decision
    reasons: tuple[str, ...] = ()
    mass: float = math.nan
    std_dev: float = math.nan
    lower_limit: float = -math.inf
    upper_limit: float = math.inf
    reject_at: Stamp | None = None
    t1: Stamp | None = None
    estimate_id: int = 0
    late: bool = False
    product: str = ''
    batch: str = ''
    batch_items: int = 0
    batch_accepted: int = 0
    batch_below_tu1: int = 0
    batch_surplus: float = 0.0
    station: int = 0
    station_at: Stamp | None = None


@dataclass(frozen=True, slots=True)
class StopRequest:
    """Why the line should stop.

    `stamp` (ns) and `item_id` are those of the item concerned, `text` has further details.
    """

    reason: StopReason
    item_id: int
    stamp: Stamp | None = None
    text: str = ''

    @property
    def hint(self) -> str:
        """What a technician should look at."""
        return f'{self.reason.hint}: {self.text}' if self.text else self.reason.hint


@dataclass(frozen=True, slots=True)
class Permission:
    """Whether the line may `run`, given at `stamp`, ns of the system clock; it soon runs out."""

    stamp: Stamp
    run: bool

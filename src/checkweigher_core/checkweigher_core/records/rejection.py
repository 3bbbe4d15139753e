# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the reject stage."""

from dataclasses import dataclass
from enum import IntEnum
import math

from checkweigher_core.records.quantities import Stamp
from checkweigher_core.records.reasons import StopReason


class Decision(IntEnum):
    """Decision on an item. The rejector removes all but ACCEPT."""

    FAULT = 0
    ACCEPT = 1
    UNDER = 2
    OVER = 3


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on one item; masses and limits are in kg.

    `item_id` is the number of the item, and `estimate_id` the same number, or 0 for a verdict
    without an estimate. The signal to the rejector is due at `reject_at`; a `late` verdict came
    after that. `batch_items` to `batch_surplus` are the values of `BatchTally`, with this item.
    `station` counts from 1, and its signal is due at `station_at`; 0 means the rejector or, for an
    accepted item, no station.
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
    """Reason for a stop of the line.

    `stamp` and `item_id` identify the item concerned, and `text` has further details.
    """

    reason: StopReason
    item_id: int
    stamp: Stamp | None = None
    text: str = ''

    @property
    def hint(self) -> str:
        """Advice for the technician."""
        return f'{self.reason.hint}: {self.text}' if self.text else self.reason.hint


@dataclass(frozen=True, slots=True)
class Permission:
    """Permission to `run` the line, given at `stamp` on the system clock; it expires soon."""

    stamp: Stamp
    run: bool

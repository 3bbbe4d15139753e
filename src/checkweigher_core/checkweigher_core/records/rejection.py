# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the reject stage."""

from dataclasses import dataclass
from enum import IntEnum
import math

from checkweigher_core.records.equality import NanEqual
from checkweigher_core.records.newer import newer
from checkweigher_core.records.quantities import Stamp
from checkweigher_core.records.reasons import StopReason


class Decision(IntEnum):
    """Decision on an item.

    The rejector or a reject station removes every item whose decision is not ACCEPT.
    """

    FAULT = 0
    ACCEPT = 1
    UNDER = 2
    OVER = 3


@dataclass(frozen=True, slots=True, eq=False)
class Verdict(NanEqual):
    """Verdict on one item. Masses and limits are in kg.

    `estimate_id` equals `item_id`, or is 0 if the verdict was given without a mass estimate. The
    signal to the rejector is due at `reject_at`, which is None if this time is unknown. If
    `station` is not 0, the reject or sorting station of this number removes the item instead of the
    rejector. The signal to the station is due at `station_at`. `late` is true if the verdict was
    given after its signal was due. The fields `batch_items` to `batch_surplus` are the totals of
    the product in the batch, including this item, as the class `BatchTally` of `checkweigher_dsp`
    counts them.
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
    station: int = newer(0)
    station_at: Stamp | None = newer(None)

    @property
    def time(self) -> int | None:
        """Time of the item in ns: t3, or t1 if t3 is unknown, or None if both are unknown."""
        return self.t3 or self.t1


@dataclass(frozen=True, slots=True)
class StopRequest:
    """Request to stop the line.

    `item_id` is the number of the item that caused the request, or 0. `stamp` is the `reject_at` of
    the verdict on this item, the stamp of a missed external reject, or None. `text` contains
    further details, or is empty.
    """

    reason: StopReason
    item_id: int
    stamp: Stamp | None = None
    text: str = ''

    @property
    def hint(self) -> str:
        """Advice for the technician, followed by `text` if there is any."""
        return f'{self.reason.hint}: {self.text}' if self.text else self.reason.hint


@dataclass(frozen=True, slots=True)
class Permission:
    """Permission to run the line. If `run` is false, the line must stop.

    The permission was given at `stamp` (system clock), and expires after `ports.FRESH_TIME` s.
    """

    stamp: Stamp
    run: bool

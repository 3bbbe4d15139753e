# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of products and batches."""

from dataclasses import dataclass
from enum import IntEnum
import math

from checkweigher_core.records.quantities import Stamp


class PerformanceState(IntEnum):
    """State of the performance test of a recipe."""

    OVERDUE = 0
    NOT_ASKED = 1
    IN_TIME = 2
    DUE = 3
    RUNNING = 4
    FAILED = 5


@dataclass(frozen=True, slots=True)
class ProductOnLine:
    """Limits, batch and rules that apply to items since `stamp`.

    Masses are in kg and include the packaging; lengths are in m, speeds in m/s. An empty `product`
    means that none is selected; if a product is `needed`, no item is then accepted. `batch_items`
    to `batch_surplus` are the values of `BatchTally` with which the batch continues.
    """

    stamp: Stamp
    product: str = ''
    batch: str = ''
    needed: bool = False
    lower_limit: float = -math.inf
    upper_limit: float = math.inf
    min_length: float = 0.0
    max_length: float = math.inf
    min_speed: float = 0.0
    max_speed: float = math.inf
    nominal: float = 0.0
    tu1: float = 0.0
    tu1_quota: float = 0.025
    mean_value: bool = False
    performance_test: bool = False
    batch_items: int = 0
    batch_accepted: int = 0
    batch_below_tu1: int = 0
    batch_surplus: float = 0.0


@dataclass(frozen=True, slots=True)
class PerformanceTest:
    """Performance test of a recipe: its state since `stamp`, and the result of the last test.

    Masses are in kg. `errors` has the error of each pass so far, NaN for a pass without a mass; the
    test passes if all are within `limit`. `who` is the person who made the test, and `last` the
    time of the last test that passed.
    """

    stamp: Stamp
    state: PerformanceState
    product: str = ''
    batch: str = ''
    text: str = ''
    who: str = ''
    due: Stamp | None = None
    stop_at: Stamp | None = None
    last: Stamp | None = None
    mass: float = math.nan
    limit: float = math.nan
    passes: int = 0
    errors: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts of one product in one batch; masses in kg, of the contents without tare.

    `stamp` is the largest t3. `reason_counts` has the number of items for each of `reasons`.
    `length_faults` and `speed_faults` count items outside the ranges of the recipe. `tu1` and `tu2`
    are the limits of directive 76/211/EEC. `mean`, `std_dev`, `giveaway` (mean minus `nominal`),
    `below_tu1` (including items below TU2), `below_tu2` and `share_below_tu1` (0..1) refer to the
    accepted items. `throughput` is in items/min since the stream began. `tu1_quota` is the share of
    a batch that may be below TU1, NaN if there is no such rule; with `mean_value` the mean may not
    be below nominal.
    """

    stamp: Stamp | None
    product: str
    batch: str
    items: int
    accepted: int
    under: int
    over: int
    faults: int
    reasons: tuple[str, ...]
    reason_counts: tuple[int, ...]
    length_faults: int
    speed_faults: int
    nominal: float
    tare: float
    mean: float
    std_dev: float
    giveaway: float
    tu1: float
    tu2: float
    below_tu1: int
    below_tu2: int
    share_below_tu1: float
    throughput: float
    tu1_quota: float = math.nan
    mean_value: bool = False


@dataclass(frozen=True, slots=True)
class FillerFeedback:
    """Correction of the filler after a subgroup of items; masses in kg, of the contents.

    `stamp` and `item_id` identify the last of the `items` items in the subgroup. The filler has to
    add `step` to its set point; `correction` is the sum of all steps. A `limited` step was reduced
    to a limit of the recipe.
    """

    stamp: Stamp | None
    product: str
    item_id: int
    items: int
    target: float
    median: float
    step: float
    correction: float
    limited: bool = False


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something that went wrong, kept until it is over and a person has acknowledged it.

    `source` is what raised it: ``stop`` (a stop request), ``fault`` (an item) or ``node`` (a node
    that was started again); `reason` is that of the request or the item, or the name of the node.
    It came at `first`, and `count` times in all. `last` is when it last began or ended. It was
    `active` for `duration` s before `last`, and is so since then if `active` is set.
    `acknowledged_by` is empty until a person acknowledges it.
    """

    source: str
    reason: str
    text: str
    first: Stamp
    last: Stamp
    count: int = 0
    active: bool = False
    duration: float = 0.0
    acknowledged_by: str = ''

    @property
    def over(self) -> bool:
        """Whether it is over and a person has acknowledged it."""
        return bool(self.acknowledged_by) and not self.active


@dataclass(frozen=True, slots=True)
class Alarms:
    """The alarms of a lane at `stamp`, in the order in which they first came."""

    stamp: Stamp
    alarms: tuple[Alarm, ...]


@dataclass(frozen=True, slots=True)
class BatchResult:
    """End of a batch at `stamp`, with the file of its record and the SHA-256 of that file."""

    stamp: Stamp
    batch: str
    record: str
    sha256: str

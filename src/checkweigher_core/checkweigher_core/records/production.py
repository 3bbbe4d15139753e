# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of products and batches."""

from dataclasses import dataclass
from enum import IntEnum
import math

from checkweigher_core.records.quantities import Stamp


class PerformanceState(IntEnum):
    """Whether the performance test of a recipe is due, and how the last one ended."""

    OVERDUE = 0
    NOT_ASKED = 1
    IN_TIME = 2
    DUE = 3
    RUNNING = 4
    FAILED = 5


@dataclass(frozen=True, slots=True)
class ProductOnLine:
    """Limits, batch and rules by which items are judged since `stamp`, ns; masses with packaging.

    While `product` is empty, none is selected: nothing is accepted then if one is `needed`. Masses
    are in kg, lengths in m, speeds in m/s. `batch_items` to `batch_surplus` are the counts of
    `BatchTally` with which the batch goes on.
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
    """The performance test of a recipe: its state since `stamp`, and what came of the last one.

    Times in ns, masses in kg; `errors` are those of each pass so far, NaN for one without a mass,
    each within `limit` if the test is to pass. `who` made it, `last` is when one has passed.
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

    `stamp` is the largest t3 in ns, `reason_counts` has the number of items of each of `reasons`.
    `length_faults` and `speed_faults` are items outside the ranges of the recipe; `tu1` and `tu2`
    are those of directive 76/211/EEC. `mean`, `std_dev`, `giveaway` (mean above `nominal`),
    `below_tu1`, which has those below TU2 as well, `below_tu2` and `share_below_tu1` (0..1) are of
    the accepted items. `throughput` is in 1/min, of the items since the stream began. The recipe
    allows a share of `tu1_quota` below TU1 in a batch, NaN without that rule, and with `mean_value`
    no mean below nominal.
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
    """What the filler should change after a subgroup of items; masses in kg, of the contents.

    `stamp` (ns) and `item_id` are those of the last item of the subgroup, which has `items`.
    `step` is to be added to the set point now, `correction` is the sum of all steps; a limit of the
    recipe has made a `limited` one smaller.
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
class BatchResult:
    """The end of a batch, at `stamp` (ns): the file of its record and the SHA-256 of that."""

    stamp: Stamp
    batch: str
    record: str
    sha256: str

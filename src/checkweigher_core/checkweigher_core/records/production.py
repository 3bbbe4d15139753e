# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of products, batches, performance tests and alarms."""

from dataclasses import dataclass
from enum import IntEnum
import math

from checkweigher_core.records.equality import NanEqual
from checkweigher_core.records.newer import newer
from checkweigher_core.records.quantities import Stamp


class PerformanceState(IntEnum):
    """State of the performance test, a periodic test with a product of known mass.

    The state is NOT_ASKED if the recipe requires no test, IN_TIME before the next test is due, DUE
    from its due time until `PerformanceTest.stop_at`, and OVERDUE after that. FAILED is the state
    after a test that has not passed.
    """

    OVERDUE = 0
    NOT_ASKED = 1
    IN_TIME = 2
    DUE = 3
    RUNNING = 4
    FAILED = 5


@dataclass(frozen=True, slots=True)
class ProductOnLine:
    """Product and batch on the line since `stamp` (system clock), with the limits of their items.

    Masses are in kg and include the packaging. Lengths are in m, speeds in m/s. `product` is empty
    while no product is selected. If `needed` is true, no item is accepted while `product` is empty.
    `nominal` is 0 if it is unknown. `tu1` is the limit TU1 of directive 76/211/EEC, 0 without a
    quota, and `tu1_quota` is the largest allowed share of items below TU1 among the accepted items.
    If `mean_value` is true, the batch mean must never be below `nominal`. If `performance_test` is
    true, all items are rejected, because a performance test is running. The fields `batch_items` to
    `batch_surplus` are the totals of this product in this batch so far, as the class `BatchTally`
    of `checkweigher_dsp` counts them. In the records of the topic ``product_in_use``, these totals
    are 0.
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

    @property
    def lacks_product(self) -> bool:
        """Whether no item is accepted, because the line needs a product and none is selected."""
        return self.needed and not self.product


@dataclass(frozen=True, slots=True, eq=False)
class PerformanceTest(NanEqual):
    """State of the performance test that a recipe requires. Stamps are on the system clock.

    `stamp` is the time at which the state began or, while a test is running, the time of its latest
    pass. `text` states why a test is due or has failed; otherwise it is empty. `who` is the person
    who makes the running test or has made the last test, or is empty before the first test. The
    next test is due at `due`, and the line stops at `stop_at` if no test has passed by then; both
    are None if no due time is set. `last` is the end of the last test that passed, None if none has
    passed. `mass` is the mass of the test product in kg. `errors` contains the weighing error in kg
    of each pass of the running or the last test, NaN for a pass without a mass. A test passes if
    the test product was weighed `passes` times, and the absolute value of each error is at most
    `limit`, in kg. Without a required test, `mass` and `limit` are NaN, and `passes` is 0.
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


@dataclass(frozen=True, slots=True, eq=False)
class Statistics(NanEqual):
    """Statistics of one product in one batch. Masses are in kg, without tare.

    `stamp` is the largest t3 of the items, None if no item has a t3. `reason_counts` contains the
    number of items with each of the `reasons`. `length_faults` and `speed_faults` are the numbers
    of items whose length or speed is outside the range of the recipe. `tu1` and `tu2` are the
    limits TU1 and TU2 of directive 76/211/EEC. `mean`, `std_dev`, `giveaway` (mean minus
    `nominal`), `below_tu1` (including items below TU2), `below_tu2` and `share_below_tu1` (0..1)
    refer to the accepted items. `throughput` is the number of items per minute between the smallest
    and the largest t3 in the present stream, NaN if fewer than two items have different t3.
    `tu1_quota` is the largest allowed share of items below TU1 among the accepted items, NaN
    without a quota. If `mean_value` is true, the batch mean must be at least `nominal`.
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
    tu1_quota: float = newer(math.nan)
    mean_value: bool = newer(False)


@dataclass(frozen=True, slots=True)
class FillerFeedback:
    """Correction of the filler after a subgroup of items. Masses are in kg, without tare.

    `stamp` is t3 of the last item in the subgroup, `item_id` is its number, and `items` is the
    number of items in the subgroup. The filler must add `step` to its set point. `correction` is
    the sum of all steps since the product was selected. `limited` is true if a limit of the recipe
    has reduced the step.
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
    """Alarm, which is kept until its cause has ended and a person has acknowledged it.

    `source` is ``stop`` for a stop request, ``fault`` for an item, and ``node`` for a restarted
    node or for a line that was not shut down. `reason` is the reason of the stop request or of the
    fault, or the name of the node. The alarm was raised `count` times, for the first time at
    `first`. `last` is the time at which the alarm was last raised or its cause ended. Before
    `last`, the alarm was active for `duration` s in total. `acknowledged_by` is empty until a
    person has acknowledged the alarm. Stamps are on the system clock.
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
    def key(self) -> tuple[str, str, int]:
        """Values that identify the alarm, and that do not change with its state."""
        return self.source, self.reason, self.first

    @property
    def over(self) -> bool:
        """Whether the cause has ended and a person has acknowledged the alarm."""
        return bool(self.acknowledged_by) and not self.active


@dataclass(frozen=True, slots=True)
class Alarms:
    """Alarms of a lane at `stamp` (system clock), in the order in which they were first raised."""

    stamp: Stamp
    alarms: tuple[Alarm, ...]


@dataclass(frozen=True, slots=True)
class BatchResult:
    """End of a batch at `stamp` (system clock), with the path and SHA-256 of the batch record."""

    stamp: Stamp
    batch: str
    record: str
    sha256: str

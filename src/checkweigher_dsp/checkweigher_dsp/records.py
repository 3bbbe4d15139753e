# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records that pass between the stages: what the machine sends, and what each stage makes of it.

Times are integers in nanoseconds on the clock of the samples, so that no stage rounds them; a
time that is not known is None. A number that is not known is NaN. How a record stands in its
message follows from names and types of the fields: see `checkweigher_dsp.ros.conversion`.
"""

from dataclasses import dataclass, field, fields
from enum import IntEnum
import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.reasons import StopReason

GRAMS = 1000.0  # in a kilogram
NANOSECONDS = 1_000_000_000
MAX_SAMPLE_RATE = 1e6  # Hz; what claims more is no load cell, and would take all memory

# A segmenter that was started again goes on at the next multiple of this number of items.
NUMBERS_AT_ONCE = 1_000

MAX_MASS = 1e6  # kg
MAX_WINDOW = 2**16  # samples of a window, or of a message

Stamp = Annotated[int, 'ns']  # on the clock of the samples


class Eye(IntEnum):
    """The photo-eyes at the two ends of the weigh belt."""

    INFEED = 0
    OUTFEED = 1


class Decision(IntEnum):
    """What is to become of an item. All but ACCEPT are rejected."""

    FAULT = 0
    ACCEPT = 1
    UNDER = 2
    OVER = 3


class StreamState(IntEnum):
    """Whether a stream of samples goes on, has ended, or was broken off by its source."""

    RUNNING = 0
    FINISHED = 1
    FAILED = 2


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


class PerformanceState(IntEnum):
    """Whether the performance test of a recipe is due, and how the last one ended."""

    OVERDUE = 0
    NOT_ASKED = 1
    IN_TIME = 2
    DUE = 3
    RUNNING = 4
    FAILED = 5


def seconds(stamp: int | None) -> float:
    """Return a stamp in seconds, NaN if it is not known."""
    return math.nan if stamp is None else stamp / NANOSECONDS


@dataclass(frozen=True, slots=True)
class LoadCell:
    """A load cell, and how its readings become kilograms.

    `sample_rate` is in Hz, `capacity` in kg, `weigh_length` (from the infeed to the outfeed eye)
    in m. `counts_per_kg` is the static sensitivity, negative where the cell is mounted upside
    down, `zero_counts` the reading of the empty belt at calibration. A reading at or beyond
    `min_counts` or `max_counts` is saturated, a load of more than `capacity` on the empty belt an
    overload: the cell carries the dead load of the belt besides.

    Raises
    ------
    ValueError
        If a field cannot describe a load cell; the message names the field.
    """

    sample_rate: float
    counts_per_kg: float
    zero_counts: float
    min_counts: int
    max_counts: int
    capacity: float
    weigh_length: float
    model: str = ''
    serial_number: str = ''

    def __post_init__(self) -> None:
        for name, (least, most, unit) in _POSSIBLE.items():
            value = getattr(self, name)
            magnitude = abs(value) if name == 'counts_per_kg' else value
            span = f'{least:g}..{most:g} {unit}'
            _require(least <= magnitude <= most, f'{name} is {value:g}, must be within {span}')
        lower, upper, zero = self.min_counts, self.max_counts, self.zero_counts
        _require(lower < upper, f'min_counts {lower} is not below max_counts {upper}')
        span = f'min_counts..max_counts, {lower}..{upper}'
        _require(lower <= zero <= upper, f'zero_counts is {zero:g}, must be within {span}')

    @classmethod
    def of(cls, parameters: object, **others: Any) -> 'LoadCell':
        """Return the load cell that parameters of the same names and `others` describe."""
        names = [entry.name for entry in fields(cls) if hasattr(parameters, entry.name)]
        return cls(**{name: getattr(parameters, name) for name in names} | others)


# What a load cell of a belt scale, its converter and its belt can be; of counts_per_kg the size.
_POSSIBLE = {
    'sample_rate': (1.0, MAX_SAMPLE_RATE, 'Hz'),
    'counts_per_kg': (1e-3, 1e9, '/kg'),
    'min_counts': (-(2**31), 2**31 - 1, 'counts'),
    'max_counts': (-(2**31), 2**31 - 1, 'counts'),
    'capacity': (1e-6, MAX_MASS, 'kg'),
    'weigh_length': (1e-3, 100.0, 'm'),
}


def _require(condition: bool, text: str) -> None:
    if not condition:
        raise ValueError(f'load cell: {text}')


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """Consecutive converter readings: `counts` (n,) int32, the first one taken at `stamp`.

    `first_index` is the index of ``counts[0]`` since the source started.
    """

    stamp: Stamp
    first_index: int
    counts: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class EyeEdge:
    """One edge of a photo-eye at `stamp`: `blocked` is its state from then on."""

    stamp: Stamp
    eye: Eye
    blocked: bool


@dataclass(frozen=True, slots=True)
class Reference:
    """The true mass of an item in kg; `stamp` is its t1. ValueError if it is no mass."""

    stamp: Stamp
    mass: float

    def __post_init__(self) -> None:
        if not 0 <= self.mass <= MAX_MASS:
            raise ValueError(f'a reference mass of {self.mass:g} kg, must be 0..{MAX_MASS:g} kg')


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """Progress of the driver or the segmenter in a stream, to which the driver gave a number.

    `stamp` is that of the last sample in ns; `samples` and `edges` were sent by the driver, or
    taken by the segmenter, which `items` have left. `text` is for a technician, empty while all
    is well. The segmenter has announced what the edges up to `last_edge`, in ns, show.
    """

    stamp: Stamp
    stream: int
    state: StreamState
    samples: int = 0
    edges: int = 0
    items: int = 0
    text: str = ''
    last_edge: Stamp | None = None


@dataclass(frozen=True, slots=True)
class Item:
    """An item on the line: the number that its window, estimate and verdict carry.

    It is announced once it can no longer be merged with another one, and again when it is
    `complete`: nothing more will be known of it by the photo-eyes before its verdict. `stamp` is
    the first of `t1`, `t2` and `t3` that is known, in ns. `line_speed`, in m/s, is its own or,
    without it, that of the last whole item. `stream` is the number of the driver's stream.
    """

    stamp: Stamp | None
    stream: int
    item_id: int  # from 1, in order of entry
    t1: Stamp | None = None  # it begins to enter
    t2: Stamp | None = None  # it is fully on the belt
    t3: Stamp | None = None  # it begins to leave
    line_speed: float = math.nan
    complete: bool = False
    reasons: tuple[str, ...] = ()  # why it cannot be weighed so far; empty if it can


@dataclass(frozen=True, slots=True)
class WeighWindow:
    """The signal of one item, with what the photo-eyes showed of the item."""

    item_id: int  # from 1, in order of entry
    t1: Stamp | None  # ns, the item begins to enter
    t2: Stamp | None  # ns, it is fully on the belt
    t3: Stamp | None  # ns, it begins to leave
    belt_speed: float = math.nan  # m/s, weigh_length / (t3 - t1)
    product_length: float = math.nan  # m, belt_speed * (t2 - t1)
    # m/s, belt_speed, or where an edge is missing that of the last whole item: no measurement,
    # only to time the rejector.
    line_speed: float = math.nan
    sample_rate: float = math.nan  # Hz
    counts_per_kg: float = math.nan  # static calibration
    zero_counts: float = math.nan  # static calibration
    zero: float = math.nan  # counts, empty belt as last seen before t1
    # counts; of a window that is later than its edges with what that lag is uncertain
    zero_std_dev: float = math.nan
    first_index: int = 0  # of counts[0] since the source started
    # ns, time of counts[0], at the nominal rate from that of the sample at window_begin, and on
    # the clock of the eyes: the lag of the samples is taken off where the rise shows one.
    stamp: Stamp = 0
    # Position in counts of the first sample at which the item before had left the belt; at dense
    # spacing it lies after t1, where the item is entering already.
    empty_begin: int = 0
    window_begin: int = 0  # position in counts of the first sample at or after t2
    window_end: int = 0  # one past the position of the last sample before t3
    # Raw readings (n,): before t2, then t2..t3, then trailing signal after t3. Empty in a fault.
    counts: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    # kg, (n,) at the same positions, (0,) until denoise has run.
    denoised: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    reasons: tuple[str, ...] = ()  # why the item cannot be weighed; empty if it can

    def __eq__(self, other: object) -> bool:
        """Compare field by field, NaN equal to NaN: two unknowns are the same window."""
        return isinstance(other, WeighWindow) and all(
            np.array_equal(np.asarray(a), np.asarray(b), equal_nan=isinstance(a, float))
            for a, b in ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        )

    @property
    def force(self) -> NDArray[np.float64]:
        """The signal in kg, zero removed: (n,) float64."""
        return self.force_between(0, len(self.counts))

    def force_between(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the part of `force` from position `begin` up to `end`."""
        force = self.counts[begin:end].astype(np.float64)
        force -= self.zero
        force /= self.counts_per_kg
        return force


@dataclass(frozen=True, slots=True)
class MassEstimate:
    """The mass of one item with its uncertainty, or the reasons why there is none.

    `mass`, `std_dev`, `zero` (empty belt relative to its calibration) and `b1` are in kg:
    mass = b1 / (1 + a1 + a2). `natural_frequency` is in Hz. `line_speed` is that of the window.
    """

    item_id: int
    t1: Stamp | None
    t2: Stamp | None
    t3: Stamp | None
    reasons: tuple[str, ...] = ()
    mass: float = math.nan
    std_dev: float = math.nan
    zero: float = math.nan
    belt_speed: float = math.nan
    product_length: float = math.nan
    line_speed: float = math.nan
    estimator: str = ''
    a1: float = math.nan
    a2: float = math.nan
    b1: float = math.nan
    natural_frequency: float = math.nan
    damping_ratio: float = math.nan

    @property
    def weighed(self) -> bool:
        """Whether there is a mass."""
        return not self.reasons


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
class ExternalReject:
    """An item that an inspection device has found bad.

    It is the item `item_id`, or if that is 0 the one that was at the `device` at `stamp`, ns.
    """

    stamp: Stamp | None
    device: str
    item_id: int = 0
    text: str = ''


@dataclass(frozen=True, slots=True)
class MachineConditions:
    """What is wrong by the machine's inputs since `stamp` (ns).

    `conditions` are words of `StopReason`, each with the input of `inputs` that shows it. What is
    not `known`, since the inputs cannot be read, is wrong as well.
    """

    stamp: Stamp
    known: bool
    conditions: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


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


@dataclass(frozen=True, slots=True)
class ZeroChange:
    """A change of the zero by the service zero; kg from the zero of calibration.

    `stamp` is the end of the empty belt that was read, `previous` the zero before, `std_dev` that
    of the new one.
    """

    stamp: Stamp
    zero: float
    previous: float
    std_dev: float


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

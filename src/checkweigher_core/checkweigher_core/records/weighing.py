# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the weighing, from the item on the belt to its mass."""

from dataclasses import dataclass, field, fields
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records.quantities import Stamp


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
class ZeroChange:
    """A change of the zero by the service zero; kg from the zero of calibration.

    `stamp` is the end of the empty belt that was read, `previous` the zero before, `std_dev` that
    of the new one.
    """

    stamp: Stamp
    zero: float
    previous: float
    std_dev: float

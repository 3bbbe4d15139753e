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
    """Item on the line, with the number that its window, estimate and verdict carry.

    The segmenter announces an item when its edges can no longer be merged with those of another
    item, and again when it is `complete`: the photo-eyes add nothing more before its verdict.
    `stamp` is the first known of `t1`, `t2` and `t3`. `line_speed`, m/s, is the speed of the item
    or, if an edge is missing, of the last whole item. `stream` is the number of its stream.
    """

    stamp: Stamp | None
    stream: int
    item_id: int  # from 1, in order of entry
    t1: Stamp | None = None  # it begins to enter
    t2: Stamp | None = None  # it is fully on the belt
    t3: Stamp | None = None  # it begins to leave
    line_speed: float = math.nan
    complete: bool = False
    reasons: tuple[str, ...] = ()  # so far, why it cannot be weighed; empty if it can


@dataclass(frozen=True, slots=True)
class WeighWindow:
    """Signal of one item with its times, speed and length from the photo-eyes."""

    item_id: int  # from 1, in order of entry
    t1: Stamp | None  # ns, the item begins to enter
    t2: Stamp | None  # ns, it is fully on the belt
    t3: Stamp | None  # ns, it begins to leave
    belt_speed: float = math.nan  # m/s, weigh_length / (t3 - t1)
    product_length: float = math.nan  # m, belt_speed * (t2 - t1)
    # m/s, belt_speed or, if an edge is missing, the speed of the last whole item. It serves only to
    # time the rejector, and does not measure this item.
    line_speed: float = math.nan
    sample_rate: float = math.nan  # Hz
    counts_per_kg: float = math.nan  # static calibration
    zero_counts: float = math.nan  # static calibration
    zero: float = math.nan  # counts, latest empty belt before t1
    # counts; includes the uncertainty of the lag if the samples are later than the edges
    zero_std_dev: float = math.nan
    first_index: int = 0  # of counts[0] since the source started
    # ns, time of counts[0] on the clock of the photo-eyes, computed at the nominal rate from the
    # sample at window_begin. If the rise of the load shows a lag of the samples, it is subtracted.
    stamp: Stamp = 0
    # Position in counts of the first sample after the previous item has left the belt. If the items
    # are close, this item is already entering then.
    empty_begin: int = 0
    window_begin: int = 0  # position in counts of the first sample at or after t2
    window_end: int = 0  # one past the position of the last sample before t3
    # Raw readings (n,): before t2, then t2..t3, then trailing signal after t3. Empty for a fault.
    counts: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    # kg, (n,) at the same positions, (0,) until denoise has run.
    denoised: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    reasons: tuple[str, ...] = ()  # why the item cannot be weighed; empty if it can

    def __eq__(self, other: object) -> bool:
        """Compare field by field; NaN equals NaN."""
        return isinstance(other, WeighWindow) and all(
            np.array_equal(np.asarray(a), np.asarray(b), equal_nan=isinstance(a, float))
            for a, b in ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        )

    @property
    def force(self) -> NDArray[np.float64]:
        """Signal in kg without the zero, (n,) float64."""
        return self.force_between(0, len(self.counts))

    def force_between(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the part of `force` from position `begin` up to `end`."""
        force = self.counts[begin:end].astype(np.float64)
        force -= self.zero
        force /= self.counts_per_kg
        return force


@dataclass(frozen=True, slots=True)
class MassEstimate:
    """Mass of one item with its standard deviation, or the reasons why it has no mass.

    `mass`, `std_dev`, `b1` and `zero` (the empty belt relative to its calibration) are in kg, and
    mass = b1 / (1 + a1 + a2). `natural_frequency` is in Hz. `line_speed` comes from the window.
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
    """Change of the zero by the service `zero`, in kg relative to the zero of the calibration.

    `stamp` is the end of the empty-belt segment that was read, `previous` the previous zero, and
    `std_dev` the standard deviation of the new zero.
    """

    stamp: Stamp
    zero: float
    previous: float
    std_dev: float

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the weighing of an item, from its entry to its mass estimate."""

from dataclasses import dataclass, field
import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records.equality import NanEqual
from checkweigher_core.records.quantities import Stamp


@dataclass(frozen=True, slots=True, eq=False)
class Item(NanEqual):
    """Item on the line. The window, the estimate and the verdict of an item have its `item_id`.

    The segmenter publishes an item when no later edge can change its number. The segmenter
    publishes the item once more, with `complete` set, when the edges of the item are final. `stamp`
    is the first of `t1`, `t2` and `t3` that is known. `line_speed` is the speed of the item in m/s
    or, if t1 or t3 is unknown, the speed of the last item with all edges. `line_speed` is NaN
    before the first item with all edges. `stream` is the number of the stream of samples.
    """

    stamp: Stamp | None
    stream: int
    item_id: int  # number of the item from 1, in order of entry
    t1: Stamp | None = None  # time at which the item begins to enter the belt
    t2: Stamp | None = None  # time at which the item is fully on the belt
    t3: Stamp | None = None  # time at which the item begins to leave the belt
    line_speed: float = math.nan
    complete: bool = False
    reasons: tuple[str, ...] = ()  # reasons why the item cannot be weighed, if any


@dataclass(frozen=True, slots=True, eq=False)
class WeighWindow(NanEqual):
    """Signal of one item, with its times, speed and length from the photo-eyes.

    `counts` contains the readings in counts from before t1 until after t3, and is empty if the item
    cannot be weighed. The fields `empty_begin`, `window_begin` and `window_end` are positions in
    `counts`. `denoised` contains the denoised signal in kg, and is empty until the stage denoise
    has added it. `zero_std_dev` includes the effect of the uncertain lag of the load behind the
    edges.
    """

    item_id: int  # number of the item from 1, in order of entry
    t1: Stamp | None  # time at which the item begins to enter the belt
    t2: Stamp | None  # time at which the item is fully on the belt
    t3: Stamp | None  # time at which the item begins to leave the belt
    belt_speed: float = math.nan  # speed in m/s, weigh_length / (t3 - t1), times in s
    product_length: float = math.nan  # length in m, belt_speed * (t2 - t1), times in s
    line_speed: float = math.nan  # belt_speed, or speed in m/s of the last item with all edges
    sample_rate: float = math.nan  # sample rate in Hz
    counts_per_kg: float = math.nan  # sensitivity of the static calibration in counts/kg
    zero_counts: float = math.nan  # zero of the static calibration in counts
    zero: float = math.nan  # tracked zero before t1 in counts
    zero_std_dev: float = math.nan  # standard deviation of `zero` in counts
    first_index: int = 0  # index of counts[0] in the stream
    stamp: Stamp = 0  # time of counts[0] minus the lag of the load behind the edges
    empty_begin: int = 0  # position of the first sample after the previous item has left
    window_begin: int = 0  # position of the first sample at or after t2
    window_end: int = 0  # position of the first sample at or after t3
    counts: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))  # shape (n,)
    denoised: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    reasons: tuple[str, ...] = ()  # reasons why the item cannot be weighed, if any

    @property
    def force(self) -> NDArray[np.float64]:
        """Signal in kg relative to the zero, of shape (n,)."""
        return self.force_between(0, len(self.counts))

    def force_between(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the part of `force` from position `begin` up to, but not including, `end`."""
        force = self.counts[begin:end].astype(np.float64)
        force -= self.zero
        force /= self.counts_per_kg
        return force


@dataclass(frozen=True, slots=True, eq=False)
class MassEstimate(NanEqual):
    """Mass of one item with its standard deviation, or the reasons why it has no mass.

    `mass`, its standard deviation `std_dev`, `b1`, and the tracked `zero` relative to the zero of
    the calibration are in kg. `a1`, `a2` and `b1` are the coefficients of the identified model
    x(k) = -a1 x(k-1) - a2 x(k-2) + b1 u(k-1) of the weigh platform, whose input u is 1 while the
    item is fully on the belt. `natural_frequency` in Hz and `damping_ratio` are properties of the
    identified model. A value that the estimator does not identify is NaN.
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
        """Whether the item has a mass, which is the case if there are no `reasons`."""
        return not self.reasons


@dataclass(frozen=True, slots=True)
class ZeroChange:
    """Change of the zero by the service `zero`. Masses are in kg.

    `zero` is the new zero and `previous` is the previous zero, both relative to the zero of the
    calibration. `std_dev` is the standard deviation of the new zero. `stamp` is the end of the
    measurement of the empty belt.
    """

    stamp: Stamp
    zero: float
    previous: float
    std_dev: float

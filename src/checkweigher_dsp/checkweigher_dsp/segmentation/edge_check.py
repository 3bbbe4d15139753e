# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Check of the photo-eye edges of each item by the rise of the load in the signal.

The load lags behind the edges by a constant time because of the filter of the amplifier, different
clocks, or a displaced or debounced eye. Without a correction, a window that is cut at the edges
would contain a part of the rise or of the fall of the load.
"""

from collections import deque
import math
from statistics import median

from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.signal.rise_lag import Bend, RiseLag

# A value is significant if it differs from 0 by more than this number of standard deviations.
_SURE = 4.0
# The lag of an item is replaced by the usual lag if they differ by at most `_LIKELY` standard
# deviations. If the lag of the item would shift its window, the limit is `_ALIKE` standard
# deviations.
_LIKELY = 2.5
_ALIKE = 1.0
# Smallest shift of a window in s. A smaller lag does not shift the window, because the lags of
# platforms differ by up to 5e-4 s.
_LEAST_SHIFT = 6e-4
# Allowed variation of the lag between items, as a fraction of the rise time t2 - t1, in addition to
# `rise_lag_tolerance`.
_SHARE = 0.02
# Largest difference between a lag and the stated lag. `_FURTHEST`, in s, allows for filters and
# displaced eyes. `_FURTHEST_SHARE`, a fraction of the rise time, is added for products whose load
# rises unevenly.
_FURTHEST = 0.01
_FURTHEST_SHARE = 0.15
_FEWEST = 5  # minimum number of items from which a lag is learned
_MOST = 25  # maximum number of items from which a lag is learned
_LAST = 3  # number of last items whose median lag is the usual lag
_RECENT = 8  # number of last items whose median lag shows a lasting change
_EVEN = math.sqrt(12.0)  # width of a uniform distribution in standard deviations.
# Largest relative difference in belt speed or in length at which a learned lag remains valid.
_SAME = 0.1


class EdgeCheck:
    """Comparison of the rise of the load of each item with the photo-eye edges of the item.

    The parameters state a lag of the load behind the edges, and whether this lag was measured. All
    lags of this class, except those in a `RiseLag`, are in s relative to the stated lag. If the
    stated lag was not measured, the lag is learned as the median over the first items of a belt
    speed and length. The lag is learned again if the speed or the length changes.
    """

    def __init__(self, parameters: SegmenterParameters) -> None:
        self._parameters = parameters
        # Numbers of items with and without a visible rise of the load.
        self.checked = self.unchecked = 0
        # Standard deviation of the last shift in s. An uneven rise of the load (a bend) may explain
        # a part of the lag. The shift is assumed to be uniformly distributed between its values
        # with and without the part of the lag that a bend explains.
        self.shift_std_dev = 0.0
        self.forget()

    def forget(self) -> None:
        """Discard the learned lag, the lags of all items, and the speed and length of the items."""
        self.learned = math.nan  # learned lag, or NaN until a lag is learned
        self._kind: tuple[float, float] | None = None  # belt speed in m/s and length in m
        self._first: list[RiseLag] = []
        self._bend = Bend(0.0, 0.0)  # usual bend of the first items
        self._recent: deque[float] = deque(maxlen=_RECENT)

    @property
    def is_stated(self) -> bool:
        """Whether the stated lag was measured."""
        return self._parameters.rise_lag_known

    @property
    def lag(self) -> float:
        """Median lag of the last items (at most eight), or NaN without items."""
        return median(self._recent) if self._recent else math.nan

    @property
    def reference(self) -> float:
        """Lag that the items are compared with.

        The lag is 0 if the stated lag was measured, otherwise the learned lag, or NaN until a lag
        is learned.
        """
        return 0.0 if self.is_stated else self.learned

    @property
    def change(self) -> float:
        """Change of the lag, which is `lag` minus `reference`.

        The change is NaN with fewer than eight items, or if `reference` is NaN.
        """
        return self.lag - self.reference if len(self._recent) == _RECENT else math.nan

    def check(self, seen: RiseLag, speed: float, length: float) -> float | None:
        """Check an item and return the shift of its window behind the edges in s.

        Returns 0 if the lag of the rise `seen` in the signal is too small or not significant, and
        None if the rise contradicts the edges. If the rise is not visible, the usual lag is checked
        instead; while the usual lag is NaN, the result is 0. `speed` is the belt speed in m/s and
        `length` the length of the item in m.
        """
        self._begin_kind(speed, length)
        self.shift_std_dev = 0.0
        if not seen.is_known:
            self.unchecked += 1
            if self._is_mismatch(self._usual, 0.0, length / speed):
                return None
            return self._sure_shift(self._usual, 0.0)
        self.checked += 1
        lag, std_dev = seen.lag - self._stated(speed), seen.std_dev
        self._recent.append(lag)
        if self._is_mismatch(lag, _SURE * std_dev, length / speed):
            lag = _without(lag - self.reference, self._own_bend(seen)) + self.reference
            std_dev = math.hypot(std_dev, seen.bend.std_dev)
            if math.isnan(lag) or self._is_mismatch(lag, _SURE * seen.std_dev, length / speed):
                return None
        self._learn(seen, speed)
        bend, bend_std_dev = self._bend
        sure = math.hypot(std_dev, bend_std_dev)
        likely = _ALIKE if self._sure_shift(_without(lag, bend), sure) else _LIKELY
        if abs(self._usual - lag) <= likely * std_dev:  # False for NaN
            lag, sure = self._usual, sure / math.sqrt(_LAST)
        shift = self._sure_shift(_without(lag, bend), sure)
        between = self._sure_shift(lag - bend, sure) - shift
        self.shift_std_dev = math.hypot(sure if shift else 0.0, between / _EVEN)
        return shift

    def _learn(self, seen: RiseLag, speed: float) -> None:
        if len(self._first) < _MOST:
            self._first.append(seen)
            self._bend = self._find_bend()
            if len(self._first) >= _FEWEST:
                self.learned = median(each.lag for each in self._first) - self._stated(speed)

    def _stated(self, speed: float) -> float:
        known = self._parameters
        return known.rise_lag + known.rise_lag_distance / speed

    @property
    def _usual(self) -> float:
        """Median lag of the last three items, or NaN with fewer items."""
        last = list(self._recent)[-_LAST:]
        return median(last) if len(last) == _LAST else math.nan

    def _find_bend(self) -> Bend:
        """Return the median bend of the first items.

        The bend and its standard deviation are 0 if the stated lag was measured, or if the bend is
        not significant.
        """
        if self.is_stated:
            return Bend(0.0, 0.0)
        bend = median(each.bend.lag for each in self._first)
        std_dev = median(each.bend.std_dev for each in self._first) / math.sqrt(len(self._first))
        return Bend(bend, std_dev) if abs(bend) > _SURE * std_dev else Bend(0.0, 0.0)

    def _own_bend(self, seen: RiseLag) -> float:
        """Return the bend of an item minus the median bend of the first items, in s.

        The result is 0 if the difference is not significant, or before the first item.
        """
        if not self._first:
            return 0.0
        own = seen.bend.lag - median(each.bend.lag for each in self._first)
        return own if abs(own) > _SURE * seen.bend.std_dev else 0.0

    def _begin_kind(self, speed: float, length: float) -> None:
        """Discard the learned lag if the belt speed or the length has changed."""
        kind = speed, length
        if self._kind is None or any(
            abs(new - old) > _SAME * old for new, old in zip(kind, self._kind, strict=True)
        ):
            self.forget()
            self._kind = kind

    def _is_mismatch(self, lag: float, margin: float, rise_time: float) -> bool:
        furthest = _FURTHEST + _FURTHEST_SHARE * rise_time + margin
        limit = self._parameters.rise_lag_tolerance + _SHARE * rise_time + margin
        # While the reference is NaN, only the limit `furthest` applies.
        return abs(lag - self.reference) > limit or abs(lag) > furthest

    def _sure_shift(self, lag: float, std_dev: float) -> float:
        """Return a lag if it is large and significant enough to shift a window, otherwise 0."""
        return lag if abs(lag) > max(_LEAST_SHIFT, _SURE * std_dev) else 0.0


def _without(lag: float, bend: float) -> float:
    """Return the part of a lag that a bend does not explain, with the sign of the lag."""
    return math.copysign(min(max(abs(lag) - math.copysign(bend, lag * bend), 0.0), abs(lag)), lag)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edge check: the load of an item rises at its edges, except for a constant lag.

The filter of an amplifier, different clocks, or a displaced or debounced eye shift the samples
relative to the edges. A window that is cut by the edges then contains a part of the rise or of the
fall. So the edges of each item are compared with the rise in the signal.
"""

from collections import deque
import math
from statistics import median

from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.signal.rise_lag import RiseLag

_SURE = 4.0  # standard deviations
# Largest deviation from the usual lag, in standard deviations, at which it replaces the lag of an
# item: if that lag alone moves no window, and if it does.
_LIKELY = 2.5
_ALIKE = 1.0
_LEAST_SHIFT = 6e-4  # s; a platform without ringing lags 5e-4 less than the usual one
_SHARE = 0.02  # of t2 - t1, variation of the rise from item to item
# Largest distance from the stated lag: in s, because of filters and displaced eyes, plus a share of
# t2 - t1, because some kinds of products rise unevenly.
_FURTHEST = 0.01
_FURTHEST_SHARE = 0.15
_FEWEST = 5  # fewest and most items from which a lag is learned
_MOST = 25
_LAST = 3  # items in the median of the latest lags
_RECENT = 8  # items that show a lasting change
_EVEN = math.sqrt(12.0)  # width of a uniform distribution in standard deviations
_SAME = 0.1  # relative difference of equal belt speeds and lengths


class EdgeCheck:
    """Comparison of the rise of each item with its edges. Lags are relative to the stated lag, s.

    If the stated lag is known, it is used from the first item on. Otherwise the lag is learned:
    it is the median of the lags of the first items that have the same speed and length. It is
    learned again if the speed or the length changes.

    Attributes
    ----------
    learned : float
        Learned lag; NaN until it is learned.
    checked, unchecked : int
        Numbers of items whose rise was seen, and not seen.
    doubt : float
        Standard deviation of the last shift, s. It includes the difference between the shifts with
        and without the bend of the products, between which any shift is equally likely.
    """

    def __init__(self, parameters: SegmenterParameters) -> None:
        self._parameters = parameters
        self.checked = self.unchecked = 0
        self.doubt = 0.0
        self.forget()

    def forget(self) -> None:
        """Discard the learned lag, and the speed and length that it belongs to."""
        self.learned = math.nan
        self._kind: tuple[float, float] | None = None  # belt speed and length
        self._first: list[RiseLag] = []
        self._recent: deque[float] = deque(maxlen=_RECENT)

    @property
    def is_stated(self) -> bool:
        """Whether the stated lag is known."""
        return self._parameters.rise_lag_known

    @property
    def lag(self) -> float:
        """Median lag of the last items, NaN if there is none."""
        return median(self._recent) if self._recent else math.nan

    @property
    def reference(self) -> float:
        """Lag with which items are compared, NaN until it is learned."""
        return 0.0 if self.is_stated else self.learned

    @property
    def change(self) -> float:
        """Change of the lag from the reference to the last items, NaN if unknown."""
        return self.lag - self.reference if len(self._recent) == _RECENT else math.nan

    def check(self, seen: RiseLag, speed: float, length: float) -> float | None:
        """Check an item and return the shift of its window behind its edges, s.

        The shift is 0 if edges and rise agree, and None if they contradict each other. `speed` is
        the belt speed in m/s, `length` the length of the item in m.
        """
        self._begin_kind(speed, length)
        self.doubt = 0.0
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
            std_dev = math.hypot(std_dev, seen.bend_std_dev)
            if math.isnan(lag) or self._is_mismatch(lag, _SURE * seen.std_dev, length / speed):
                return None
        self._learn(seen, speed)
        bend, doubt = self._bend()
        sure = math.hypot(std_dev, doubt)
        likely = _ALIKE if self._sure_shift(_without(lag, bend), sure) else _LIKELY
        if abs(self._usual - lag) <= likely * std_dev:  # false if NaN
            lag, sure = self._usual, sure / math.sqrt(_LAST)
        shift = self._sure_shift(_without(lag, bend), sure)
        between = self._sure_shift(lag - bend, sure) - shift
        self.doubt = math.hypot(sure if shift else 0.0, between / _EVEN)
        return shift

    def _learn(self, seen: RiseLag, speed: float) -> None:
        if len(self._first) < _MOST:
            self._first.append(seen)
            if len(self._first) >= _FEWEST:
                self.learned = median(each.lag for each in self._first) - self._stated(speed)

    def _stated(self, speed: float) -> float:
        known = self._parameters
        return known.rise_lag + known.rise_lag_distance / speed

    @property
    def _usual(self) -> float:
        """Median lag of the last three items, NaN with fewer."""
        last = list(self._recent)[-_LAST:]
        return median(last) if len(last) == _LAST else math.nan

    def _bend(self) -> tuple[float, float]:
        """Return the lag that the bend of the products causes, and its standard deviation.

        The bend does not move a window. A known lag contains it already.
        """
        if self.is_stated:
            return 0.0, 0.0
        bend = median(each.bend for each in self._first)
        doubt = median(each.bend_std_dev for each in self._first) / math.sqrt(len(self._first))
        return (bend, doubt) if abs(bend) > _SURE * doubt else (0.0, 0.0)

    def _own_bend(self, seen: RiseLag) -> float:
        """Return the difference between the bend of an item and that of its kind, 0 if not sure."""
        own = seen.bend - median(each.bend for each in self._first) if self._first else 0.0
        return own if abs(own) > _SURE * seen.bend_std_dev else 0.0

    def _begin_kind(self, speed: float, length: float) -> None:
        """Discard the learned lag if the belt speed or the length has changed."""
        kind = speed, length
        if self._kind is None or any(
            abs(new - old) > _SAME * old for new, old in zip(kind, self._kind, strict=True)
        ):
            self.forget()
            self._kind = kind

    def _is_mismatch(self, lag: float, doubt: float, rise_time: float) -> bool:
        furthest = _FURTHEST + _FURTHEST_SHARE * rise_time + doubt
        limit = self._parameters.rise_lag_tolerance + _SHARE * rise_time + doubt
        # The first comparison is false until a reference is known.
        return abs(lag - self.reference) > limit or abs(lag) > furthest

    def _sure_shift(self, lag: float, std_dev: float) -> float:
        """Return a lag if it is large and sure enough to move a window, else 0."""
        return lag if abs(lag) > max(_LEAST_SHIFT, _SURE * std_dev) else 0.0


def _without(lag: float, bend: float) -> float:
    """Return the part of a lag that a bend does not explain, of the same sign as the lag."""
    return math.copysign(min(max(abs(lag) - math.copysign(bend, lag * bend), 0.0), abs(lag)), lag)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edge check: the load of an item rises when its photo-eyes say so, but for a lag that is constant.

The filter of an amplifier, two clocks, an eye off its place or debounced: all move the samples
against the edges, and a window that is cut by the eyes then holds a part of the rise or of the
fall. The signal shows the rise, so it confirms the eyes item by item.
"""

from collections import deque
import math
from statistics import median

from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.signal.rise_lag import RiseLag

_SURE = 4.0  # standard deviations
_LIKELY = 2.5  # of an item whose own lag is not sure, else:
_ALIKE = 1.0
_LEAST_SHIFT = 6e-4  # s; a platform without ringing lags 5e-4 less than the usual one
_SHARE = 0.02  # of t2 - t1, by which products ride on differently from item to item
# From the lag that is stated, while none is learned: share of t2 - t1 by which a whole kind of
# product may ride on unevenly, and filters and eyes off their place, s.
_FURTHEST_SHARE = 0.15
_FURTHEST = 0.01
_FEWEST = 5  # items that a lag is learned from, and the most
_MOST = 25
_LAST = 3  # items in the median of the latest lags
_RECENT = 8  # items that show a lasting change
_EVEN = math.sqrt(12.0)  # width of a uniform distribution, in standard deviations
_SAME = 0.1  # relative difference of belt speeds and of lengths that are one


class EdgeCheck:
    """Compare the rise of each item with its edges; lags in s are beyond the stated one.

    A lag that is stated as known holds from the first item on. Else the median of the first items
    of one speed and length is the lag of this machine, and it stays what it is; where speed or
    length change it is learned again.

    Attributes
    ----------
    learned : float
        What has been learned, NaN before that.
    checked, unchecked : int
        Items so far whose rise was seen, and that of the others was not.
    doubt : float
        Standard deviation of the last shift, s: of the lag where it is one, and where the bend of
        the products says another shift than the lag, any between them is as likely.
    """

    def __init__(self, parameters: SegmenterParameters) -> None:
        self._parameters = parameters
        self.checked = self.unchecked = 0
        self.doubt = 0.0
        self.forget()

    def forget(self) -> None:
        """Forget what was learned: the source has started again."""
        self.learned = math.nan
        self._kind: tuple[float, float] | None = None  # belt speed and length
        self._first: list[RiseLag] = []
        self._recent: deque[float] = deque(maxlen=_RECENT)

    @property
    def is_stated(self) -> bool:
        """Whether the lag is stated as known."""
        return self._parameters.rise_lag_known

    @property
    def lag(self) -> float:
        """The lag of the last items, median; NaN if there is none."""
        return median(self._recent) if self._recent else math.nan

    @property
    def reference(self) -> float:
        """The lag that items are compared with, NaN while it is learned."""
        return 0.0 if self._parameters.rise_lag_known else self.learned

    @property
    def change(self) -> float:
        """How far the last items, all of them, are from the reference; NaN if not known yet."""
        return self.lag - self.reference if len(self._recent) == _RECENT else math.nan

    def check(self, seen: RiseLag, speed: float, length: float) -> float | None:
        """Take an item and return by how much its window has to be later than by the eyes, s.

        0 if eyes and rise agree as far as the signal shows, None if the rise is not where the eyes
        say. `speed` is that of the belt in m/s, `length` that of the item in m.
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
        if len(self._first) < _MOST:
            self._first.append(seen)
            if len(self._first) >= _FEWEST:
                self.learned = median(each.lag for each in self._first) - self._stated(speed)
        bend, doubt = self._bend()
        sure = math.hypot(std_dev, doubt)
        likely = _ALIKE if self._sure_shift(_without(lag, bend), sure) else _LIKELY
        if abs(self._usual - lag) <= likely * std_dev:  # of few items it is NaN
            lag, sure = self._usual, sure / math.sqrt(_LAST)
        shift = self._sure_shift(_without(lag, bend), sure)
        between = self._sure_shift(lag - bend, sure) - shift
        self.doubt = math.hypot(sure if shift else 0.0, between / _EVEN)
        return shift

    def _stated(self, speed: float) -> float:
        known = self._parameters
        return known.rise_lag + known.rise_lag_distance / speed

    @property
    def _usual(self) -> float:
        """Lag of the last items, NaN while they are few."""
        last = list(self._recent)[-_LAST:]
        return median(last) if len(last) == _LAST else math.nan

    def _bend(self) -> tuple[float, float]:
        """Return what of the lag is the bend of these products, and its standard deviation.

        It is no reason to move a window. A lag that is stated as known has it already.
        """
        if self._parameters.rise_lag_known:
            return 0.0, 0.0
        bend = median(each.bend for each in self._first)
        doubt = median(each.bend_std_dev for each in self._first) / math.sqrt(len(self._first))
        return (bend, doubt) if abs(bend) > _SURE * doubt else (0.0, 0.0)

    def _own_bend(self, seen: RiseLag) -> float:
        """Return what the bend of an item is more than that of its kind, 0 where it is not sure."""
        own = seen.bend - median(each.bend for each in self._first) if self._first else 0.0
        return own if abs(own) > _SURE * seen.bend_std_dev else 0.0

    def _begin_kind(self, speed: float, length: float) -> None:
        """Learn again where belt speed or length are others than before."""
        kind = speed, length
        if self._kind is None or any(
            abs(new - old) > _SAME * old for new, old in zip(kind, self._kind, strict=True)
        ):
            self.forget()
            self._kind = kind

    def _is_mismatch(self, lag: float, doubt: float, rise_time: float) -> bool:
        furthest = _FURTHEST + _FURTHEST_SHARE * rise_time + doubt
        if math.isnan(self.reference):
            return abs(lag) > furthest
        limit = self._parameters.rise_lag_tolerance + _SHARE * rise_time + doubt
        return abs(lag - self.reference) > limit or abs(lag) > furthest

    def _sure_shift(self, lag: float, std_dev: float) -> float:
        """Return a lag that matters, 0 if it does not or is not known."""
        return lag if abs(lag) > max(_LEAST_SHIFT, _SURE * std_dev) else 0.0


def _without(lag: float, bend: float) -> float:
    """Return a lag less a bend: a bend can explain a lag, not cause one."""
    return math.copysign(min(max(abs(lag) - math.copysign(bend, lag * bend), 0.0), abs(lag)), lag)

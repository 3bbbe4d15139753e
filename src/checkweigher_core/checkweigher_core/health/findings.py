# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings on the health of a line, and statistics of recent values.

Times are in s on a monotonic clock, and are passed by the caller.
"""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import takewhile
import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

MINUTE = 60.0  # seconds per minute
_MAX_VALUES = 10_000  # default of the largest number of entries in a `Recent`


class Level(IntEnum):
    """Severity of a finding, with the numbers of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Concern:
    """Problem of a node, with advice for the technician."""

    level: Level
    text: str
    hint: str


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding on one aspect of a node, such as its clock. docs/reasons.md lists the aspects.

    `values` contains numbers and texts by name. The name of a number that has a unit ends with the
    unit, as in ``free_gb``.
    """

    aspect: str
    level: Level
    text: str  # description of the problem or of the normal state, in one line
    hint: str = ''  # advice for the technician; empty if there is no problem
    values: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """Text and hint of the finding, in one line."""
        return f'{self.text}; {self.hint}' if self.hint else self.text


Values = Mapping[str, float | str]


def warn_if(holds: bool, text: str, hint: str) -> Concern | None:
    """Return a warning if a condition holds, otherwise None."""
    return Concern(Level.WARN, text, hint) if holds else None


def error_if(holds: bool, text: str, hint: str) -> Concern | None:
    """Return an error if a condition holds, otherwise None."""
    return Concern(Level.ERROR, text, hint) if holds else None


def conclude(
    aspect: str, well: str, concerns: Iterable[Concern | None] = (), values: Values | None = None
) -> Finding:
    """Return the finding on an aspect of a node.

    The finding has the level, text and hint of the most severe concern. Of several concerns that
    are equally severe, the first is used. If all `concerns` are None, the level is OK, and the text
    is `well`.
    """
    none = Concern(Level.OK, well, '')
    worst = max(filter(None, concerns), key=lambda concern: concern.level, default=none)
    return Finding(aspect, worst.level, worst.text, worst.hint, values or {})


T = TypeVar('T')


class Recent(deque[tuple[float, T]]):
    """Entries of the last `duration` s with their times in s, but at most `limit` entries.

    An entry that is too old is removed by the next call of `forget`. If there are too many entries,
    the oldest is removed.
    """

    def __init__(self, duration: float = MINUTE, limit: int = _MAX_VALUES) -> None:
        super().__init__(maxlen=limit)
        self._duration = duration

    def forget(self, now: float) -> None:
        """Remove the entries that are too old at time `now` in s."""
        while self and self[0][0] <= now - self._duration:
            self.popleft()


class RecentValues(Recent[float]):
    """Values of the last `duration` s with their times in s. Without values, quantiles are NaN."""

    def add(self, time: float, value: float) -> None:
        """Add a value that was observed at `time` in s. NaN and infinities are ignored."""
        if math.isfinite(value):
            self.append((time, value))

    @property
    def span(self) -> float:
        """Time in s from the oldest to the latest value, 0 without values."""
        return self[-1][0] - self[0][0] if self else 0.0

    @property
    def values(self) -> NDArray[np.float64]:
        """Values in the order of their times, shape (n,)."""
        return np.array([value for _, value in self])

    @property
    def total(self) -> float:
        """Sum of the values, 0 without values."""
        return math.fsum(value for _, value in self)

    @property
    def median(self) -> float:
        """Median of the values."""
        return self.quantile(0.5)

    @property
    def largest(self) -> float:
        """Largest value."""
        return self.quantile(1.0)

    @property
    def smallest(self) -> float:
        """Smallest value."""
        return self.quantile(0.0)

    def quantile(self, share: float) -> float:
        """Return the quantile `share` (0..1) of the values, with linear interpolation."""
        return float(np.quantile(self.values, share)) if self else math.nan

    @property
    def slope(self) -> float:
        """Theil-Sen slope of the values per second, NaN if no two values have different times.

        The Theil-Sen estimator is robust against up to 29 % outliers.
        """
        times, values = np.reshape(self, (-1, 2)).T
        first, second = np.triu_indices(len(times), 1)
        elapsed = times[second] - times[first]
        moved = elapsed > 0
        if not moved.any():
            return math.nan
        return float(np.median((values[second] - values[first])[moved] / elapsed[moved]))


class RecentItems(Recent[tuple[str, ...]]):
    """Results of the last `count` items, with the reasons why items failed.

    The result of an item that is older than `duration` s is removed by the next call of `forget`.
    """

    def __init__(self, count: int = 50, duration: float = 10 * MINUTE) -> None:
        super().__init__(duration, count)

    def add(self, time: float, reasons: Iterable[str] = ()) -> None:
        """Add the result of an item at `time` in s. `reasons` is empty if the item succeeded."""
        self.append((time, tuple(reasons)))

    @property
    def failed(self) -> int:
        """Number of failed items among the stored results."""
        return sum(bool(reasons) for _, reasons in self)

    @property
    def failed_in_a_row(self) -> int:
        """Number of consecutive failed items up to the latest item, 0 if the latest succeeded."""
        return sum(1 for _ in takewhile(lambda entry: entry[1], reversed(self)))

    def main_reason(self, count: int) -> str:
        """Return the most frequent reason why one of the last `count` items failed.

        Only the first reason of each item counts. The result is empty if none of the items failed.
        """
        firsts = Counter(reasons[0] for _, reasons in list(self)[-count:] if reasons)
        return firsts.most_common(1)[0][0] if firsts else ''

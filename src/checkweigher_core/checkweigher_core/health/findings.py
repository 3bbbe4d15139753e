# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings on the health of a line, each with a level and a hint, and values seen lately.

Times are seconds on a clock that never steps back, which the caller reads.
"""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import takewhile
import math
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

MINUTE = 60.0  # s, what is called lately
_MAX_VALUES = 10_000


class Level(IntEnum):
    """Severity, by the numbers of DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Concern:
    """One thing that is wrong: what is, and what to check."""

    level: Level
    text: str
    hint: str


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding on one aspect of a node."""

    aspect: str  # as in docs/reasons.md
    level: Level
    text: str  # what is, in one sentence
    hint: str = ''  # what to check; empty where all is well
    values: Mapping[str, float | str] = field(default_factory=dict)  # the unit in the key

    @property
    def message(self) -> str:
        """Text and hint in one line."""
        return f'{self.text}; {self.hint}' if self.hint else self.text


def conclude(
    aspect: str, well: str, concerns: Iterable[Concern],
    values: Mapping[str, float | str] | None = None,
) -> Finding:  # fmt: skip
    """Return the finding of the worst concern, of the first of these; `well` if there is none."""
    fine = Concern(Level.OK, well, '')
    worst = max(concerns, key=lambda concern: concern.level, default=fine)
    return Finding(aspect, worst.level, worst.text, worst.hint, values or {})


T = TypeVar('T')


class Recent(Generic[T]):
    """Entries of the last `duration` seconds, at most `limit` of them."""

    def __init__(self, duration: float, limit: int) -> None:
        self._duration = duration
        self._entries: deque[tuple[float, T]] = deque(maxlen=limit)

    def __len__(self) -> int:
        return len(self._entries)

    def forget(self, now: float) -> None:
        """Drop what is older than the duration at `now`, s."""
        while self._entries and self._entries[0][0] <= now - self._duration:
            self._entries.popleft()


class RecentValues(Recent[float]):
    """The values of the last `duration` seconds; without any their statistics are NaN."""

    def __init__(self, duration: float = MINUTE, limit: int = _MAX_VALUES) -> None:
        super().__init__(duration, limit)

    def add(self, time: float, value: float) -> None:
        """Take a value seen at `time`, s; one that is not finite is passed over."""
        if math.isfinite(value):
            self._entries.append((time, value))

    @property
    def span(self) -> float:
        """From the time of the oldest value to that of the latest, s; 0 without any."""
        return self._entries[-1][0] - self._entries[0][0] if self._entries else 0.0

    @property
    def values(self) -> NDArray[np.float64]:
        """The values, (n,), the oldest first."""
        return np.array([value for _, value in self._entries])

    @property
    def total(self) -> float:
        """Sum of the values, 0 without any."""
        return math.fsum(value for _, value in self._entries)

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
        """Return the value that a share of all does not exceed, interpolated between two values."""
        return float(np.quantile(self.values, share)) if self._entries else math.nan

    @property
    def slope(self) -> float:
        """Change of the values in a second, the median over all pairs; NaN with fewer than two.

        The estimator of Theil and Sen: up to 29 % of the values may be wrong by any amount.
        """
        if len(self._entries) < 2:
            return math.nan
        times, values = np.array(self._entries).T
        first, second = np.triu_indices(len(times), 1)
        elapsed = times[second] - times[first]
        moved = elapsed > 0
        if not moved.any():
            return math.nan
        return float(np.median((values[second] - values[first])[moved] / elapsed[moved]))


class RecentItems(Recent[tuple[str, ...]]):
    """Outcome of the last `count` items within `duration`, s, and why those failed that did."""

    def __init__(self, count: int = 50, duration: float = 10 * MINUTE) -> None:
        super().__init__(duration, count)

    def add(self, time: float, reasons: Iterable[str] = ()) -> None:
        """Take an item and why it failed; with no reason it did not."""
        self._entries.append((time, tuple(reasons)))

    @property
    def failed(self) -> int:
        """Number of those that failed."""
        return sum(bool(reasons) for _, reasons in self._entries)

    @property
    def failed_in_a_row(self) -> int:
        """Number of those that failed since the last one that did not."""
        return sum(1 for _ in takewhile(lambda entry: entry[1], reversed(self._entries)))

    @property
    def main_reason(self) -> str:
        """The first reason of most of those that failed, empty if none did."""
        firsts = Counter(reasons[0] for _, reasons in self._entries if reasons)
        return firsts.most_common(1)[0][0] if firsts else ''

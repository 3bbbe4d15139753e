"""What a technician is told of the line: findings with a level, and what was seen lately.

Times are seconds on a clock that never steps back; the caller has it, nothing here does.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
import math
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

MINUTE = 60.0  # s, what is called lately
_MAX_VALUES = 10_000
_value = itemgetter(1)


class Level(IntEnum):
    """How bad it is; the numbers of DiagnosticStatus."""

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
    """How one aspect of a node is.

    Attributes
    ----------
    aspect : str
        As in docs/interfaces.md.
    level : Level
        How bad it is.
    text, hint : str
        What is, in one sentence, and what to check; no hint where all is well.
    values : mapping of str to float or str
        The figures behind it, the unit in the key.
    """

    aspect: str
    level: Level
    text: str
    hint: str = ''
    values: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """Text and hint in one line."""
        return f'{self.text}; {self.hint}' if self.hint else self.text


def conclude(
    aspect: str,
    well: str,
    concerns: Iterable[Concern],
    values: Mapping[str, float | str] | None = None,
) -> Finding:
    """Return the finding of the worst concern, of the first of these; `well` if there is none."""
    worst = max(concerns, key=lambda concern: concern.level, default=None)
    if worst is None:
        return Finding(aspect, Level.OK, well, values=values or {})
    return Finding(aspect, worst.level, worst.text, worst.hint, values or {})


class RecentValues:
    """The values of the last `duration` seconds, at most `limit` of them.

    Parameters
    ----------
    duration : float
        s.
    limit : int
        Values.
    """

    def __init__(self, duration: float = MINUTE, limit: int = _MAX_VALUES) -> None:
        self._duration = duration
        self._entries: deque[tuple[float, float]] = deque(maxlen=limit)
        self._slope: float | None = None  # of these entries

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, time: float, value: float) -> None:
        """Take a value seen at `time`, s; one that is not finite is passed over."""
        if math.isfinite(value):
            self._entries.append((time, value))
            self._slope = None

    def forget(self, now: float) -> None:
        """Drop what is older than the duration at `now`, s."""
        while self._entries and self._entries[0][0] <= now - self._duration:
            self._entries.popleft()
            self._slope = None

    def clear(self) -> None:
        """Drop all."""
        self._entries.clear()
        self._slope = None

    @property
    def span(self) -> float:
        """From the time of the oldest value to that of the latest, s; 0 without any."""
        return self._entries[-1][0] - self._entries[0][0] if self._entries else 0.0

    @property
    def values(self) -> NDArray[np.float64]:
        """The values, the oldest first."""
        return np.array(list(map(_value, self._entries)))

    @property
    def oldest(self) -> float:
        """The oldest value, NaN without any."""
        return self._entries[0][1] if self._entries else math.nan

    @property
    def total(self) -> float:
        """Sum of the values."""
        return math.fsum(map(_value, self._entries))

    @property
    def median(self) -> float:
        """Median of the values, NaN without any."""
        return self.quantile(0.5)

    @property
    def largest(self) -> float:
        """Largest value, NaN without any."""
        return max(map(_value, self._entries), default=math.nan)

    @property
    def smallest(self) -> float:
        """Smallest value, NaN without any."""
        return min(map(_value, self._entries), default=math.nan)

    def quantile(self, share: float) -> float:
        """Return the value that a share of all does not exceed, NaN without any.

        Between two values it is interpolated. Of some hundred numpy would take ten times as long.
        """
        if not self._entries:
            return math.nan
        ordered = sorted(map(_value, self._entries))
        below, part = divmod(share * (len(ordered) - 1), 1.0)
        low = ordered[int(below)]
        return low + part * (ordered[int(below) + 1] - low) if part else low

    @property
    def slope(self) -> float:
        """Change of the values in a second, the median over all pairs; NaN with fewer than two.

        Of Theil and Sen: up to 29 % of the values may be anything.
        """
        if self._slope is None:
            self._slope = self._new_slope()
        return self._slope

    def _new_slope(self) -> float:
        if len(self._entries) < 2:
            return math.nan
        times, values = np.array(self._entries).T
        first, second = np.triu_indices(len(times), 1)
        elapsed = times[second] - times[first]
        moved = elapsed > 0
        if not moved.any():
            return math.nan
        return float(np.median((values[second] - values[first])[moved] / elapsed[moved]))


@dataclass(frozen=True, slots=True)
class _Outcome:
    time: float
    reasons: tuple[str, ...]


class RecentItems:
    """What became of the last items, and why those that failed did.

    Parameters
    ----------
    count : int
        Items that are remembered.
    duration : float
        s, for which they are.
    """

    def __init__(self, count: int = 50, duration: float = 10 * MINUTE) -> None:
        self._duration = duration
        self._items: deque[_Outcome] = deque(maxlen=count)

    def __len__(self) -> int:
        return len(self._items)

    def add(self, time: float, reasons: Iterable[str] = ()) -> None:
        """Take an item and why it failed; with no reason it did not."""
        self._items.append(_Outcome(time, tuple(reasons)))

    def forget(self, now: float) -> None:
        """Drop what is older than the duration at `now`, s."""
        while self._items and self._items[0].time <= now - self._duration:
            self._items.popleft()

    @property
    def failed(self) -> int:
        """How many of them failed."""
        return sum(bool(item.reasons) for item in self._items)

    @property
    def failed_in_a_row(self) -> int:
        """How many failed since the last one that did not."""
        count = 0
        for item in reversed(self._items):
            if not item.reasons:
                break
            count += 1
        return count

    @property
    def main_reason(self) -> str:
        """The first reason of most of those that failed, empty if none did."""
        counts: dict[str, int] = {}
        for item in self._items:
            for reason in item.reasons[:1]:
                counts[reason] = counts.get(reason, 0) + 1
        return max(counts, key=lambda reason: counts[reason], default='')

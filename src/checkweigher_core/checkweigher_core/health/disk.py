# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Free space on the disk to which the line writes, and the time until the disk is full."""

from collections.abc import Callable
import math
from pathlib import Path
import shutil

from checkweigher_core.health.findings import Finding, RecentValues, conclude, error_if, warn_if

_ASPECT = 'Disk'
_PERIOD = 600.0  # time in s between two readings of the free space
_DAY = 86_400.0  # seconds per day
_SHORTEST_SPAN = 6 * _PERIOD  # shortest time in s from which a trend is estimated
_WARNING = 30.0  # number of days until the disk is full, below which a warning is shown
_LEAST = 100e6  # free bytes below which an error is shown; a record of 100,000 items needs less
_HINT = 'move recorded items and passes to another disk; see docs/backup.md'


def free_bytes(folder: Path) -> float:
    """Return the number of free bytes on the disk of a folder, NaN if the number is unknown."""
    try:
        return float(shutil.disk_usage(folder).free)
    except OSError:
        return math.nan


class DiskWatch:
    """Monitor of the free space on a disk, with the readings of the last two days.

    The function `free` returns the number of free bytes. Times are in s on a monotonic clock. The
    trend is the median of the slopes of all pairs of readings, so that a recording that is removed
    after a few hours does not affect the trend.
    """

    def __init__(self, free: Callable[[], float]) -> None:
        self._free = free
        self._values = RecentValues(2 * _DAY)
        self._looked = -math.inf
        self._finding = conclude(_ASPECT, 'not known yet')

    def finding(self, now: float) -> Finding:
        """Return the finding "Disk" at time `now` in s.

        The free space is read at most every 600 s. Until the next reading, the finding is
        unchanged.
        """
        if now - self._looked >= _PERIOD:
            self._looked = now
            self._values.forget(now)
            self._values.add(now, free := self._free())
            self._finding = self._conclude(free)
        return self._finding

    def _conclude(self, free: float) -> Finding:
        slope = self._values.slope if self._values.span >= _SHORTEST_SPAN else math.nan
        days = free / -slope / _DAY if slope < 0 else math.inf
        text = f'{free / 1e9:.1f} GB are free'
        return conclude(
            _ASPECT,
            text,
            [
                error_if(free < _LEAST, f'nearly full: {text}', _HINT),
                warn_if(days < _WARNING, f'full in about {days:.0f} days: {text}', _HINT),
            ],
            {'free_gb': free / 1e9, 'days_left': days},
        )

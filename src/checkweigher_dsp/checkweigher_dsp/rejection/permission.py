# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rule by which the line may run: all that weighs its items is fresh, and no stop is requested."""

from collections.abc import Mapping

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.records import NANOSECONDS, StreamStatus

_HINTS = {
    'samples': 'check load cell, driver and segmenter: no new samples are taken',
    'eyes': 'check that the driver runs: nothing publishes photo_eyes',
    'load cell': 'check that the driver runs: nothing publishes load_cell/info',
}
_STAGE_HINT = 'check its process: it has ended, or is halted'


class PermissionRule:
    """Rule of the permission; `fresh_time` in s is the age from which samples are not fresh.

    Without `deadlines` nothing runs out: only a stop request withdraws the permission. Times are ns
    of a clock that never steps back.
    """

    def __init__(self, fresh_time: float, *, deadlines: bool) -> None:
        self.deadlines = deadlines
        self._fresh_time = round(NANOSECONDS * fresh_time)
        self._progress = (0, 0)  # stream and samples that the segmenter has taken
        self._progressed: int | None = None
        self._missing: tuple[str, ...] = ()
        self._stopped = True

    def add_progress(self, status: StreamStatus, now: int) -> None:
        """Add a status of the segmenter."""
        if status.samples and (status.stream, status.samples) != self._progress:
            self._progress, self._progressed = (status.stream, status.samples), now

    def may_run(self, present: Mapping[str, bool], now: int, *, stopped: bool) -> bool:
        """Return whether the line may run.

        `present` tells by name what is there: stages, ``eyes`` and ``load cell``. `stopped` tells
        whether a stop is requested.
        """
        since = self._progressed
        fresh = {**present, 'samples': since is not None and now - since <= self._fresh_time}
        self._missing = tuple(name for name, is_there in fresh.items() if not is_there)
        self._stopped = stopped
        return not stopped and not (self._missing and self.deadlines)

    def fresh_for(self, now: int) -> int:
        """Return how long the samples are fresh without further ones, 0 if they are not."""
        return max((self._progressed or 0) + self._fresh_time - now, 0)

    def finding(self) -> Finding:
        """Return the aspect Permission of the diagnostics, as of the last decision."""
        concerns = [
            Concern(Level.WARN, f'withdrawn: no {name}', _HINTS.get(name, _STAGE_HINT))
            for name in self._missing
            if self.deadlines and self._progressed is not None  # a line that starts is well
        ]
        given = not self._stopped and not (self._missing and self.deadlines)
        return conclude('Permission', 'given' if given else 'withdrawn', concerns)

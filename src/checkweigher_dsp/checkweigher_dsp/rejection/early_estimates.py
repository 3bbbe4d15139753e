# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimates that came before the announcement of their item."""

from checkweigher_core.records import MassEstimate


class EarlyEstimates:
    """Estimates of items that are not complete, by number; times in ns.

    Attributes
    ----------
    unknown : int
        Number of estimates whose items were never announced, and have no verdict.
    """

    def __init__(self) -> None:
        self.unknown = 0
        self._waiting: dict[int, tuple[MassEstimate, int | None]] = {}

    def add(self, estimate: MassEstimate, until: int | None) -> None:
        """Add an estimate that waits `until` a time on the clock of arrivals, None for ever."""
        self._waiting[estimate.item_id] = estimate, until

    def take(self, number: int) -> MassEstimate | None:
        """Remove and return the estimate of an item, None if it has not come."""
        estimate, _ = self._waiting.pop(number, (None, None))
        return estimate

    @property
    def due(self) -> int | None:
        """Time at which the next estimate has waited long enough, None if there is none."""
        return min(
            (until for _, until in self._waiting.values() if until is not None), default=None
        )

    def advance(self, now: int) -> None:
        """Drop the estimates that have waited long enough."""
        for number, (_, until) in list(self._waiting.items()):
            if until is not None and until <= now:
                del self._waiting[number]
                self.unknown += 1

    def clear(self) -> None:
        """Drop all estimates."""
        self._waiting.clear()

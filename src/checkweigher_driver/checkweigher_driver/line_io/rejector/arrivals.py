# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arrival times of items at the rejector by their verdicts, on a clock that never steps."""

from collections.abc import Iterable
from typing import NamedTuple

from checkweigher_core.records import NANOSECONDS, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_driver.line_io.clock_steps import ClockStepWatch
from checkweigher_driver.line_io.rejector.belt_items import BeltItem
from checkweigher_driver.line_io.rejector.belt_motion import BeltMotion

# Smallest relative change of the travel time that shows two merged products.
_OTHER_WAY = 0.2
_MAY_BE_TWO = {Reason.DISTANCE_FAULT.value, Reason.EDGE_MISMATCH.value}
# Longest time to the rejector; a later reject time is not on the clock of this machine.
_FURTHEST = 600 * NANOSECONDS
_CLOCK_STEP = 5_000_000  # ns
# Reasons that make the speed from the eyes unreliable, because the belt may have stopped.
_SPEED_IN_DOUBT = {Reason.BELT_STOPPED.value, Reason.BELT_SPEED_CHANGED.value}


class Times(NamedTuple):
    """Times of an item at rejector or station, at the outfeed eye and at the infeed eye, ns."""

    due: int
    since: int | None
    entered: int | None


class Arrivals:
    """Times of the items of a belt; `clock` has the offset from their stamps to the clock of `now`.

    If the edges of two products were merged, their item takes a different time from the infeed eye
    to the rejector than a single product.
    """

    def __init__(self, motion: BeltMotion) -> None:
        self.clock = ClockStepWatch(_CLOCK_STEP)
        self._motion = motion
        self._way: int | None = None  # last item, infeed eye to rejector, ns of running belt

    def times(self, verdict: Verdict, now: int) -> Times | None:
        """Return the times of an item, None if unknown or if it may be two merged products."""
        times = self._by_eyes(verdict, now)
        if times is None or times.entered is None:
            return times
        belt, before = self._motion.time, self._way
        way = belt.arrival(*times)[0] - belt.at(times.entered)
        if not _MAY_BE_TWO.intersection(verdict.reasons):
            self._way = way
        elif before is not None and abs(way - before) > _OTHER_WAY * before:
            return None
        return times

    def _by_eyes(self, verdict: Verdict, now: int) -> Times | None:
        """Return the times of an item by its edges, None if they are not known."""
        to_monotonic = self.clock.look()
        in_doubt = self._motion.measured is None and _SPEED_IN_DOUBT.intersection(verdict.reasons)
        if verdict.reject_at is None or to_monotonic is None or in_doubt:
            return None
        due = verdict.reject_at + to_monotonic
        if due - now > _FURTHEST:
            return None
        t1, t3 = (None if t is None else t + to_monotonic for t in (verdict.t1, verdict.t3))
        return Times(due, t3, t1)

    def entered_before(self, verdict: Verdict, time: int) -> bool:
        """Return whether an item entered the belt before a time and has never left it."""
        to_monotonic = self.clock.look()
        if to_monotonic is None or verdict.t1 is None or verdict.t3 is not None:
            return False
        return verdict.t1 + to_monotonic < time

    def unjudged(
        self, items: Iterable[BeltItem], now: int, late: int, to_monotonic: int | None
    ) -> list[BeltItem]:
        """Return the items without a verdict that were due at the rejector over `late` ns ago."""
        if self._way is None or to_monotonic is None:
            return []
        belt = self._motion.time
        latest = belt.at(now) - self._way - late
        return [
            item
            for item in items
            if item.decision is None
            and item.entered is not None
            and belt.at(item.entered + to_monotonic) < latest
        ]


def at_station(verdict: Verdict, times: Times | None) -> Times | None:
    """Return the times of an item at its station instead of the rejector."""
    if times is None or not verdict.station:
        return times
    if verdict.station_at is None or verdict.reject_at is None:
        return None
    return times._replace(due=times.due + verdict.station_at - verdict.reject_at)

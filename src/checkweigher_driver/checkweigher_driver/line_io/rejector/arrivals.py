# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Times at which items arrive at the rejector, on the monotonic clock."""

from collections.abc import Iterable
from typing import NamedTuple

from checkweigher_core.records import NANOSECONDS, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_driver.line_io.clock_steps import ClockStepWatch
from checkweigher_driver.line_io.rejector.belt_items import BeltItem
from checkweigher_driver.line_io.rejector.belt_motion import BeltMotion

# Relative change of the travel time above which an item counts as two merged products. Only items
# with one of the reasons in `_MAY_BE_TWO` are checked.
_OTHER_TRAVEL = 0.2
_MAY_BE_TWO = {Reason.DISTANCE_FAULT.value, Reason.EDGE_MISMATCH.value}
# Longest travel time to the rejector in ns. A reject time that is further in the future must be on
# the clock of another computer.
_FURTHEST = 600 * NANOSECONDS
# Reasons of a verdict that make the computed arrival unreliable, because the belt may have stopped
# or changed its speed during the passage of the item.
_SPEED_IN_DOUBT = {Reason.BELT_STOPPED.value, Reason.BELT_SPEED_CHANGED.value}
_CLOCK_STEP = 5_000_000  # smallest detected step of the real-time clock, in ns


class Times(NamedTuple):
    """Times in ns at which an item is at the rejector or a station, and at the two photo-eyes.

    All times are on the monotonic clock. `due` is the time at the rejector or the station, `since`
    the time at the outfeed eye, and `entered` the time at the infeed eye. `since` and `entered` are
    None if they are unknown.
    """

    due: int
    since: int | None
    entered: int | None


class Arrivals:
    """Conversion of the stamps in verdicts to times on the monotonic clock.

    If two products were merged into one item, its travel time from the infeed eye to the rejector
    differs from the travel time of a single product. The times of merged products count as unknown.
    """

    def __init__(self, motion: BeltMotion) -> None:
        self.clock = ClockStepWatch(_CLOCK_STEP)
        self._motion = motion
        # Belt time in ns from the infeed eye to the rejector for the last item that certainly was
        # one product, None before the first such item.
        self._travel: int | None = None

    def times(self, verdict: Verdict, now: int) -> Times | None:
        """Return the times of an item, or None if they are unknown or two products were merged."""
        times = self._by_eyes(verdict, now)
        if times is None or times.entered is None:
            return times
        belt, before = self._motion.time, self._travel
        travel = belt.arrival(*times)[0] - belt.at(times.entered)
        if not _MAY_BE_TWO.intersection(verdict.reasons):
            self._travel = travel
        elif before is not None and abs(travel - before) > _OTHER_TRAVEL * before:
            return None
        return times

    def _by_eyes(self, verdict: Verdict, now: int) -> Times | None:
        """Return the times of an item from its stamps, or None if they are unknown."""
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
        """Return whether an item was at the infeed eye before `time`, and never at the outfeed eye.

        `time` is in ns on the monotonic clock. Returns False if the time at the infeed eye is
        unknown.
        """
        to_monotonic = self.clock.look()
        if to_monotonic is None or verdict.t1 is None or verdict.t3 is not None:
            return False
        return verdict.t1 + to_monotonic < time

    def unjudged(
        self, items: Iterable[BeltItem], now: int, late: int, to_monotonic: int | None
    ) -> list[BeltItem]:
        """Return the items without a verdict that reached the rejector more than `late` ns ago.

        Each item is assumed to have the travel time of the last item that certainly was one
        product. `to_monotonic` is the monotonic time minus the real time in ns, or None if it is
        unknown. The list is empty if the travel time or `to_monotonic` is unknown.
        """
        if self._travel is None or to_monotonic is None:
            return []
        belt = self._motion.time
        latest = belt.at(now) - self._travel - late
        return [
            item
            for item in items
            if item.decision is None
            and item.entered is not None
            and belt.at(item.entered + to_monotonic) < latest
        ]


def at_station(verdict: Verdict, times: Times | None) -> Times | None:
    """Return `times` with the arrival of the item at its station instead of the rejector.

    Returns None if the arrival is unknown. If the item has no station, `times` is returned.
    """
    if times is None or not verdict.station:
        return times
    if verdict.station_at is None or verdict.reject_at is None:
        return None
    return times._replace(due=times.due + verdict.station_at - verdict.reject_at)

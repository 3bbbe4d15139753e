# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Deadlines of the verdicts, so that the rejector can be told in time."""

import math

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, Item, Verdict
from checkweigher_dsp.rejection.items import PendingItem
from checkweigher_dsp.rejection.outfeed_watch import OutfeedEdge
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.timing import ArrivalClock

# Times in ns.
_PATIENCE = NANOSECONDS // 10  # for the mass of an item without a reject time
_PATIENCE_GIVEN_UP = NANOSECONDS  # for the mass of an item that the segmenter has given up
# For an announcement; longer than the segmenter waits when samples stall.
_PATIENCE_UNTAKEN = 3 * NANOSECONDS // 10
PATIENCE_UNHEARD = 5 * NANOSECONDS  # for the first announcement, or for the item of an estimate
_MAX_EDGES = 1_000


class Deadlines:
    """Deadlines of the verdicts, on the clock of arrivals; all times in ns.

    The time of an item runs from the undelayed arrival of its t3 edge.

    Attributes
    ----------
    parameters : RejectParameters
        Places and times; may be replaced at any time.
    newest : int
        Stamp of the newest samples in the segmenter.
    """

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters
        self._line_speed = math.nan  # m/s, of the last item
        self._heard: int | None = None  # arrival of the first announcement
        self.restart()

    def restart(self) -> None:
        """Begin a new stream, in which the same stamps may come again."""
        self.newest = 0
        self._arrivals = ArrivalClock()
        self._came: dict[int, int] = {}  # arrivals of the latest outfeed edges by stamp

    def add_edge(self, edge: EyeEdge, now: int) -> int:
        """Add an edge that came at `now`, and return its undelayed arrival."""
        came = self._arrivals.came(edge.stamp, now)
        if edge.eye == Eye.OUTFEED and edge.blocked:
            self._came[edge.stamp] = came
            if len(self._came) > _MAX_EDGES:
                del self._came[next(iter(self._came))]
        return came

    def add_item(self, item: Item, now: int | None) -> None:
        """Add an announcement."""
        if self._heard is None:
            self._heard = now
        if not math.isnan(item.line_speed):
            self._line_speed = item.line_speed

    def set(self, pending: PendingItem, now: int | None) -> None:
        """Set the times of the verdict on a complete item."""
        t3, speed = pending.item.t3, pending.item.line_speed
        pending.reject_at = reject_at = self.parameters.reject_time(t3, speed)
        if now is None:
            return
        came = None if t3 is None else self._came.get(t3, self._arrivals.at(t3))
        if came is None or t3 is None or reject_at is None:
            pending.due = now + (_PATIENCE_GIVEN_UP if t3 is None else _PATIENCE)
            return
        pending.late_from = came + reject_at - t3
        pending.due = pending.late_from - self._head_start(t3, reject_at)

    def of_edge(self, edge: OutfeedEdge, speed: float) -> tuple[int, int | None]:
        """Return the deadline of a verdict by an outfeed edge, and its reject time if known.

        `speed` is the belt speed of its item in m/s, NaN if unknown. A stage that has just started
        waits for the latched announcements.
        """
        if self._heard is None:
            return edge.came + PATIENCE_UNHEARD, None
        history = self._heard + _PATIENCE_UNTAKEN
        speed = self._line_speed if math.isnan(speed) else speed
        reject_at = self.parameters.reject_time(edge.stamp, speed)
        if reject_at is None:
            return max(edge.came + _PATIENCE_UNTAKEN, history), None
        due = edge.came + reject_at - edge.stamp - self._head_start(edge.stamp, reject_at)
        return max(due, history), reject_at

    def await_devices(self, pending: PendingItem, over: int | None, now: int | None) -> bool:
        """Return whether a verdict waits for inspection devices; sets its deadline.

        It waits until the stamp `over`, when all of them have answered, but not beyond the deadline
        of the item.
        """
        ready = None if over is None else self._arrivals.at(over)
        if now is None or ready is None or ready <= now:
            return False
        pending.ready = ready
        pending.due = ready if pending.due is None else min(pending.due, ready)
        return pending.due > now

    def is_late(self, verdict: Verdict, late_from: int | None, now: int | None) -> bool:
        """Return whether a verdict comes too late for its rejector or station."""
        if now is None:
            return False
        reject_at = verdict.reject_at
        if reject_at is None:
            return late_from is not None and now > late_from
        if late_from is None:
            late_from = self._arrivals.at(reject_at)
        if late_from is None:  # in a stage that has just started
            return reject_at < self.newest
        lead = reject_at - verdict.station_at if verdict.station_at else 0
        return now > late_from - lead

    def _head_start(self, t3: int, reject_at: int) -> int:
        """Return the least lead of a verdict over its reject time, ns."""
        known = self.parameters
        travel = (reject_at - t3) / NANOSECONDS + known.actuator_delay
        speed = known.rejector_distance / travel if travel > 0 else math.nan
        return round(NANOSECONDS * known.verdict_margin) + known.earliest_lead(speed)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Deadlines of the verdicts, so that the rejector receives each verdict in time."""

import math

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, Item, Verdict
from checkweigher_dsp.rejection.items import PendingItem
from checkweigher_dsp.rejection.outfeed_watch import OutfeedEdge
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.timing import ArrivalClock

_PATIENCE = NANOSECONDS // 10  # waiting time in ns for the mass of an item without a reject time
_PATIENCE_GIVEN_UP = NANOSECONDS  # waiting time in ns for the mass of an item without t3.
# Waiting time in ns for an announcement after an outfeed edge, longer than the time after which the
# segmenter announces items without their samples.
_PATIENCE_UNTAKEN = 3 * NANOSECONDS // 10
# Waiting time in ns for the first announcement, and for the announcement of an item whose estimate
# has arrived.
PATIENCE_UNHEARD = 5 * NANOSECONDS
_MAX_EDGES = 1_000  # maximum number of stored edges


class Deadlines:
    """Deadlines of the verdicts on the clock of arrivals, a monotonic clock. All times are in ns.

    The deadline of an item is computed from the time at which its outfeed edge would have arrived
    without a transmission delay.
    """

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters  # parameters, which may be replaced at any time
        self._line_speed = math.nan  # last announced belt speed in m/s, or NaN
        self._heard: int | None = None  # arrival time of the first announcement, or None
        self.restart()

    def restart(self) -> None:
        """Begin a new stream, in which stamps may be repeated."""
        self.newest = 0  # stamp of the newest samples that the segmenter has processed
        self._arrivals = ArrivalClock()
        self._came: dict[int, int] = {}  # arrival times of the latest outfeed edges, by stamp

    def add_edge(self, edge: EyeEdge, now: int) -> int:
        """Add an edge that arrived at `now`.

        Returns the time at which the edge would have arrived without a transmission delay.
        """
        came = self._arrivals.came(edge.stamp, now)
        if edge.eye == Eye.OUTFEED and edge.blocked:
            self._came[edge.stamp] = came
            if len(self._came) > _MAX_EDGES:
                del self._came[next(iter(self._came))]
        return came

    def add_item(self, item: Item, now: int | None) -> None:
        """Store the line speed of an announcement, and `now` if it is the first announcement.

        `now` is the time at which the announcement arrived, or None without a clock. An unknown
        speed is not stored.
        """
        if self._heard is None:
            self._heard = now
        if not math.isnan(item.line_speed):
            self._line_speed = item.line_speed

    def set(self, pending: PendingItem, now: int | None) -> None:
        """Set the reject time of a complete item and, unless `now` is None, its deadline.

        If the reject time or the arrival of the outfeed edge is unknown, the deadline is a fixed
        time after `now`. If the reject time and the arrival are known, `late_from` is set as well.
        """
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
        """Return the deadline and the reject time of an item that left without an announcement.

        `edge` is the outfeed edge of the item, and `speed` is its belt speed in m/s. If `speed` is
        NaN, the speed of the last announced item is used. The reject time is None if no plausible
        speed is known or nothing has been announced yet. After a start of the stage, the deadline
        is later, so that latched announcements can arrive before it.
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
        """Set the deadline of a verdict that waits for inspection devices.

        `over` is the stamp at which the answer times of all devices are over, or None if the
        verdict waits for no device. Returns whether the verdict waits. The verdict does not wait
        beyond the deadline of the item. The verdict does not wait at all if `now` is None, or
        before the first edge of the stream has arrived.
        """
        ready = None if over is None else self._arrivals.at(over)
        if now is None or ready is None or ready <= now:
            return False
        pending.ready = ready
        pending.due = ready if pending.due is None else min(pending.due, ready)
        return pending.due > now

    def is_late(self, verdict: Verdict, late_from: int | None, now: int | None) -> bool:
        """Return whether a verdict is too late for the rejector or its station.

        `late_from` is the arrival time after which the verdict is too late for the rejector, or
        None if this time is not stored for the item. If `now` is None, the result is False.
        """
        if now is None:
            return False
        reject_at = verdict.reject_at
        if reject_at is None:
            return late_from is not None and now > late_from
        if late_from is None:
            late_from = self._arrivals.at(reject_at)
        if late_from is None:
            # No edge has arrived in this stream, so that only stamps can be compared.
            return reject_at < self.newest
        lead = reject_at - verdict.station_at if verdict.station_at else 0
        return now > late_from - lead

    def _head_start(self, t3: int, reject_at: int) -> int:
        """Return the least time in ns by which a verdict must precede its reject time."""
        known = self.parameters
        travel = (reject_at - t3) / NANOSECONDS + known.actuator_delay
        speed = known.rejector_distance / travel if travel > 0 else math.nan
        return round(NANOSECONDS * known.verdict_margin) + known.earliest_lead(speed)

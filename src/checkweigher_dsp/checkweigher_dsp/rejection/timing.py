# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks of the reject stage, for time stamps and for arrivals."""

import math

from checkweigher_core.records import NANOSECONDS

_DRIFT = 500e-6  # largest relative drift between two clocks.
# Time in ns. A stamp that precedes the newest stamp by more than 2 s belongs to a new stream.
RESTART = 2 * NANOSECONDS


def belt_speed(t1: int | None, t3: int | None, length: float | None) -> float:
    """Return the belt speed in m/s, or NaN if it is unknown.

    `t1` and `t3` are the times in ns at which an item reaches the infeed and the outfeed eye, and
    `length` is the distance between the eyes in m.
    """
    if t1 is None or t3 is None or t3 <= t1 or length is None:
        return math.nan
    return length * NANOSECONDS / (t3 - t1)


class StreamClock:
    """Clock that shows the present time on the scale of the time stamps of messages.

    If the clock is not `running`, it shows the stamp of the last message. Times are in ns. `now` is
    the present time on the monotonic clock of the computer, which also gives the arrival times of
    messages.
    """

    def __init__(self, *, running: bool) -> None:
        self.running = running
        self._newest: tuple[int, int] | None = None

    def saw(self, stamp: int, now: int) -> None:
        """Set the clock by the stamp of a message that arrived at `now`."""
        self._newest = (stamp, now)

    def at(self, now: int) -> int | None:
        """Return the time that the clock shows at `now`, or None before the first message."""
        if self._newest is None:
            return None
        stamp, came = self._newest
        return stamp + (now - came if self.running else 0)

    def reaches(self, stamp: int, now: int) -> int | None:
        """Return the time on the monotonic clock at which this clock shows `stamp`.

        If this clock already shows `stamp` or a later time, the result is `now`. The result is None
        before the first message, or if the clock is not running and has not reached `stamp`.
        """
        time = self.at(now)
        if time is None or (time < stamp and not self.running):
            return None
        return now + max(stamp - time, 0)


class ArrivalClock:
    """Clock that shows when an edge would have arrived without a delay.

    After a halt of a process or of the network, edges may arrive long after their items have passed
    the rejector. A delay is relative to the edge with the least delay so far, because the clocks of
    stamps and arrivals may have any difference and drift. Times are in ns.
    """

    def __init__(self) -> None:
        self._least = 0  # least difference between arrival and stamp in ns
        self._newest: tuple[int, int] | None = None

    def came(self, stamp: int, now: int) -> int:
        """Return when an edge that arrived at `now` would have arrived without a delay."""
        lag = now - stamp
        if self._newest is None or stamp < self._newest[0] - RESTART:
            self._least = lag
        else:
            self._least = min(lag, self._least + round(_DRIFT * (now - self._newest[1])))
        self._newest = stamp, now
        return stamp + self._least

    def at(self, stamp: int) -> int | None:
        """Return the arrival time of an edge without a delay, or None before the first edge."""
        return None if self._newest is None else stamp + self._least

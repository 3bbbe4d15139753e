# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks of the reject stage: the time of the stamps, and the undelayed arrival of an edge."""

import math

from checkweigher_core.records import NANOSECONDS

# Relative drift between two clocks, larger than in any machine.
_DRIFT = 500e-6
# Stamps that are further back belong to a new stream.
RESTART = 2 * NANOSECONDS


def belt_speed(t1: int | None, t3: int | None, length: float | None) -> float:
    """Return the belt speed in m/s from edges in ns at a distance of `length` m, NaN if unknown."""
    if t1 is None or t3 is None or t3 <= t1 or length is None:
        return math.nan
    return length * NANOSECONDS / (t3 - t1)


class StreamClock:
    """Clock of the stamps. If it is not `running`, it shows the stamp of the last message."""

    def __init__(self, *, running: bool) -> None:
        self.running = running
        self._newest: tuple[int, int] | None = None

    def saw(self, stamp: int, now: int) -> None:
        """Set the clock by a message that came at `now`, ns of a clock that never steps back."""
        self._newest = (stamp, now)

    def at(self, now: int) -> int | None:
        """Return the time of the stamps at `now`, ns, None before the first message."""
        if self._newest is None:
            return None
        stamp, came = self._newest
        return stamp + (now - came if self.running else 0)

    def reaches(self, stamp: int, now: int) -> int | None:
        """Return the time in ns at which the clock shows `stamp`, not before `now`.

        Returns None if only another message can move the clock there. Result and `now` are on the
        clock of arrivals.
        """
        time = self.at(now)
        if time is None or (time < stamp and not self.running):
            return None
        return now + max(stamp - time, 0)


class ArrivalClock:
    """Clock of arrivals: the time at which an edge would have come without a delay.

    After a halt of a process or of the network, edges may come long after their products have
    passed the rejector. Delays are relative to the fastest edge so far, because the clocks of
    stamps and arrivals may differ by any amount, and drift.
    """

    def __init__(self) -> None:
        self._least = 0  # least arrival minus stamp
        self._newest: tuple[int, int] | None = None

    def came(self, stamp: int, now: int) -> int:
        """Return the undelayed arrival of an edge that came at `now`; it is not after `now`.

        Times are in ns, on a clock that never steps back.
        """
        lag = now - stamp
        if self._newest is None or stamp < self._newest[0] - RESTART:
            self._least = lag
        else:
            self._least = min(lag, self._least + round(_DRIFT * (now - self._newest[1])))
        self._newest = stamp, now
        return stamp + self._least

    def at(self, stamp: int) -> int | None:
        """Return the undelayed arrival of `stamp` in ns, None before the first edge."""
        return None if self._newest is None else stamp + self._least

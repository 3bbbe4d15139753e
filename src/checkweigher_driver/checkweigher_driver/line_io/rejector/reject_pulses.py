# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pulse schedule of the rejector or of a station, with one pulse for each item that it removes.

The schedule is in belt time, which is the time for which the belt has run. A stop of the belt
therefore delays the pulse of an item on its way to the rejector by the duration of the stop.
"""

from bisect import insort
from collections import deque
from dataclasses import dataclass
import math
from typing import NamedTuple

_MAX_STOPS = 1000


class _Stop(NamedTuple):
    begin: int
    end: int
    stood_before: int  # total duration of the earlier stops in ns


class BeltTime:
    """Time in ns for which the belt has run, as a function of the time on a clock."""

    def __init__(self) -> None:
        self._stops: deque[_Stop] = deque(maxlen=_MAX_STOPS)
        self._stopped_at: int | None = None
        self._stood = 0  # total duration in ns of the stops that have ended

    @property
    def stopped(self) -> bool:
        """Whether the belt is stopped."""
        return self._stopped_at is not None

    def stop(self, now: int) -> None:
        """Record a stop of the belt at time `now`."""
        if self._stopped_at is None:
            self._stopped_at = now

    def run(self, now: int) -> int:
        """Record a start of the belt at time `now`; return the belt time."""
        if self._stopped_at is not None:
            self._stops.append(_Stop(self._stopped_at, now, self._stood))
            self._stood += now - self._stopped_at
            self._stopped_at = None
        return now - self._stood

    def at(self, time: int) -> int:
        """Return the belt time at a time on the clock, according to the stops so far."""
        if self._stopped_at is not None and time >= self._stopped_at:
            return self._stopped_at - self._stood
        for stop in reversed(self._stops):
            if time >= stop.end:
                return time - stop.stood_before - (stop.end - stop.begin)
            if time >= stop.begin:
                return stop.begin - stop.stood_before
        return time

    def when(self, belt_time: int) -> float:
        """Return the time on the clock at a future belt time, infinity if the belt is stopped."""
        return math.inf if self.stopped else belt_time + self._stood

    def arrival(self, due: int, since: int | None, entered: int | None) -> tuple[int, bool]:
        """Return the belt time at which an item arrives at the rejector, and whether it is delayed.

        An item is delayed by a stop of the belt. The arguments are times on the clock: `due` is the
        arrival without a stop, `since` the time at the outfeed eye, and `entered` the time at the
        infeed eye. `since` and `entered` are None if they are unknown. If the belt was stopped
        while the item was between the eyes, its measured speed is too low, and `due` is corrected.
        """
        begin, stood = self.at(due), False
        if since is not None:
            travel = due - since
            if entered is not None and entered < since:
                run = self.at(since) - self.at(entered)
                stood = run < since - entered
                travel = travel * run // (since - entered)
            begin = self.at(since) + travel
        # A stop that has not ended does not count as a delay, because `resume` extends the pulse.
        return begin, stood or (not self.stopped and begin != self.at(due))


@dataclass(frozen=True, slots=True)
class PulseTimes:
    """Durations of the pulse schedule in ns."""

    duration: int  # duration of the pulse for one item
    min_pause: int  # shortest pause between two pulses; closer pulses are joined
    late_tolerance: int  # largest delay with which a pulse still hits its item
    belt_margin: int  # extension at both ends of a pulse that a stop of the belt has delayed


class RejectPulses:
    """Schedule of the pulses of the rejector or of a station.

    `skipped` is the number of pulses during which `acting` was not called.
    """

    def __init__(self, times: PulseTimes, belt: BeltTime) -> None:
        self._times = times
        self.belt = belt
        self._pulses: list[tuple[int, int]] = []  # start and end of each pulse in belt time
        self._seen = False  # whether `acting` was called during the first pulse
        self.skipped = 0

    def resume(self, here: int) -> None:
        """Extend all unfinished pulses by `belt_margin` at both ends after a stop of the belt.

        `here` is the belt time of the stop in ns. A pulse that has not begun is not extended to a
        time before `here`.
        """
        waiting = [(begin, end) for begin, end in self._pulses if end > here]
        self._pulses = []
        for begin, end in waiting:
            self._put(begin, end, here, self._times.belt_margin)

    def act(self, now: int) -> None:
        """Begin a pulse at time `now`."""
        here = self.belt.at(now)
        self._put(here, here + self._times.duration, here)

    def add(self, due: int, since: int | None, now: int, entered: int | None = None) -> int:
        """Add the pulse of an item; return the delay of the pulse in ns, 0 if it is in time.

        `BeltTime.arrival` has the same arguments `due`, `since` and `entered`. A pulse is in time
        if it is late by at most `late_tolerance`. A later pulse begins at time `now`.
        """
        begin, delayed = self.belt.arrival(due, since, entered)
        here = self.belt.at(now)
        if here - begin > self._times.late_tolerance:
            self.act(now)
            return here - begin
        end = begin + self._times.duration
        self._put(begin, end, here, self._times.belt_margin if delayed else 0)
        return 0

    def _put(self, begin: int, end: int, here: int, margin: int = 0) -> None:
        """Add a pulse with a margin at both ends, and join pulses that are too close."""
        insort(self._pulses, (max(begin - margin, min(begin, here)), end + margin))
        joined = [self._pulses[0]]
        for following in self._pulses[1:]:
            first, last = joined[-1]
            if following[0] - last < self._times.min_pause:
                joined[-1] = first, max(last, following[1])
            else:
                joined.append(following)
        self._pulses = joined

    def acting(self, now: int) -> bool:
        """Return whether the rejector has to act at time `now`."""
        here = self.belt.at(now)
        while self._pulses and self._pulses[0][1] <= here:
            del self._pulses[0]
            self.skipped += not self._seen
            self._seen = False
        self._seen = self.begun(now)
        return self._seen

    def begun(self, now: int) -> bool:
        """Return whether the first pulse in the schedule has begun."""
        return bool(self._pulses) and self._pulses[0][0] <= self.belt.at(now)

    def next_change(self, now: int) -> float:
        """Return the time in ns of the next change of `acting`.

        Returns infinity if no change is scheduled, or if the belt is stopped.
        """
        acting = self.acting(now)
        return self.belt.when(self._pulses[0][1 if acting else 0]) if self._pulses else math.inf

    def clear(self) -> None:
        """Remove all pulses."""
        self._pulses = []
        self._seen = False

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pulse schedule of the rejector: one pulse for each rejected item, on the time of the belt.

The time of the belt stands still while the belt does: a product that has not reached the rejector
yet gets its pulse later by as long as the belt stood.
"""

from bisect import insort
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

_MAX_STOPS = 1000  # that are remembered


class _Stop(NamedTuple):
    begin: int
    end: int
    stood_before: int  # ns for which the belt had stood by the beginning of this stop


class BeltTime:
    """The time for which the belt has run, ns, against the time of a clock."""

    def __init__(self) -> None:
        self._stops: deque[_Stop] = deque(maxlen=_MAX_STOPS)
        self._stopped_at: int | None = None
        self._stood = 0  # ns, in all the stops that are over

    @property
    def stopped(self) -> bool:
        """Whether the belt stands still."""
        return self._stopped_at is not None

    def stop(self, now: int) -> None:
        """Note that the belt has stopped."""
        if self._stopped_at is None:
            self._stopped_at = now

    def run(self, now: int) -> None:
        """Note that the belt runs."""
        if self._stopped_at is not None:
            self._stops.append(_Stop(self._stopped_at, now, self._stood))
            self._stood += now - self._stopped_at
            self._stopped_at = None

    def at(self, time: int) -> int:
        """Return the time of the belt at a time of the clock, by the stops that are known now."""
        if self._stopped_at is not None and time >= self._stopped_at:
            return self._stopped_at - self._stood
        for stop in reversed(self._stops):
            if time >= stop.end:
                return time - stop.stood_before - (stop.end - stop.begin)
            if time >= stop.begin:
                return stop.begin - stop.stood_before
        return time

    def when(self, belt_time: int) -> int | None:
        """Return the time of the clock at a time of the belt that is yet to come.

        None while the belt stands still.
        """
        return None if self.stopped else belt_time + self._stood

    def arrival(self, due: int, since: int | None, entered: int | None) -> tuple[int, bool]:
        """Return when an item is at the rejector, and whether a stop delayed it.

        All times but that are of the clock. At `due` it is there if the belt does not stop. At
        `since` it was where `due` was computed from, at `entered` at the infeed eye: if the belt
        has stood in between, its speed by the eyes, from which `due` was computed, is too slow by
        that.
        """
        begin, stood = self.at(due), False
        if since is not None:
            travel = due - since
            if entered is not None and entered < since:
                run = self.at(since) - self.at(entered)
                stood = run < since - entered
                travel = travel * run // (since - entered)
            begin = self.at(since) + travel
        # A pulse that waits for the belt to run gets its margin then.
        return begin, stood or (not self.stopped and begin != self.at(due))


@dataclass(frozen=True, slots=True)
class PulseTimes:
    """Durations of the pulse schedule, ns."""

    duration: int  # of the pulse of one item
    min_pause: int  # pulses that are closer become one
    late_tolerance: int  # the item of a pulse that begins later may have passed
    belt_margin: int  # by which a pulse is longer at both ends if the belt stopped before it


class RejectPulses:
    """The pulses of the rejector, on the time of a `belt`.

    `skipped` counts those that ended before `acting` was asked while they lasted.
    """

    def __init__(self, times: PulseTimes, belt: BeltTime | None = None) -> None:
        self._times = times
        self._belt = belt or BeltTime()
        self._pulses: list[tuple[int, int]] = []  # begin and end, in the time of the belt
        self._seen = False  # the first of them, acting
        self.skipped = 0

    def belt(self, running: bool, now: int) -> None:
        """Note whether the belt runs; while it stands no pulse begins or ends."""
        if not running:
            self._belt.stop(now)
        elif self._belt.stopped:
            here = self._belt.at(now)
            self._belt.run(now)
            self.resume(here)

    def resume(self, here: int) -> None:
        """Note that the belt runs again, after it stood at the time `here` of the belt, ns."""
        pulses, self._pulses = self._pulses, []
        for begin, end in pulses:
            if end > here:
                self._put(begin, end, here, self._times.belt_margin)

    def add(
        self, due: int | None, since: int | None, now: int, entered: int | None = None
    ) -> int | None:
        """Take a rejected item; return by how many ns its pulse is late, 0 if it is in time.

        Its pulse begins at `due`, ns, if the belt does not stop. None if that is not known: the
        rejector acts at once, perhaps on another item, and None is returned. `since` and `entered`
        are those of `BeltTime.arrival`.
        """
        here, duration = self._belt.at(now), self._times.duration
        if due is None:
            self._put(here, here + duration, here)
            return None
        begin, delayed = self._belt.arrival(due, since, entered)
        late = here - begin
        if late > self._times.late_tolerance:
            self._put(here, here + duration, here)
            return late
        self._put(begin, begin + duration, here, self._times.belt_margin if delayed else 0)
        return 0

    def _put(self, begin: int, end: int, here: int, margin: int = 0) -> None:
        """Add a pulse, longer by a margin at both ends, but not into the past; join close ones."""
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
        """Tell whether the rejector is to act."""
        here = self._belt.at(now)
        while self._pulses and self._pulses[0][1] <= here:
            del self._pulses[0]
            self.skipped += not self._seen
            self._seen = False
        self._seen = self.begun(now)
        return self._seen

    def begun(self, now: int) -> bool:
        """Tell whether the first pulse has begun; `acting` has not seen its end."""
        return bool(self._pulses) and self._pulses[0][0] <= self._belt.at(now)

    def next_change(self, now: int) -> int | None:
        """Return when `acting` changes next, ns; None if nothing is to come."""
        acting = self.acting(now)
        return self._belt.when(self._pulses[0][1 if acting else 0]) if self._pulses else None

    def clear(self) -> None:
        """Forget all pulses."""
        self._pulses = []
        self._seen = False

"""When the rejector acts: one pulse for each rejected item, on the time of the belt.

The time of the belt stands still while the belt does: a product that has not reached the rejector
yet gets its pulse later by as long as the belt stood.
"""

from bisect import insort
from collections import deque

_MAX_STOPS = 1000  # that are remembered


class BeltTime:
    """The time for which the belt has run, ns, against the time of a clock."""

    def __init__(self) -> None:
        # When the belt stopped, when it ran again, and for how long it had stood before.
        self._stops: deque[tuple[int, int, int]] = deque(maxlen=_MAX_STOPS)
        self._stopped_at: int | None = None

    @property
    def stopped(self) -> bool:
        """Whether the belt stands still."""
        return self._stopped_at is not None

    @property
    def _stood(self) -> int:
        if not self._stops:
            return 0
        begin, end, before = self._stops[-1]
        return before + end - begin

    def stop(self, now: int) -> None:
        """Note that the belt has stopped."""
        if self._stopped_at is None:
            self._stopped_at = now

    def run(self, now: int) -> None:
        """Note that the belt runs."""
        if self._stopped_at is not None:
            self._stops.append((self._stopped_at, now, self._stood))
            self._stopped_at = None

    def at(self, time: int) -> int:
        """Return the time of the belt at a time of the clock; the belt may have stopped since."""
        if self._stopped_at is not None and time >= self._stopped_at:
            return self._stopped_at - self._stood
        for begin, end, before in reversed(self._stops):
            if time >= end:
                return time - before - (end - begin)
            if time >= begin:
                return begin - before
        return time

    def when(self, belt_time: int) -> int | None:
        """Return when the clock gets to a time of the belt that is yet to come.

        None while the belt stands still.
        """
        return None if self.stopped else belt_time + self._stood


class RejectPulses:
    """The pulses of the rejector.

    Parameters
    ----------
    duration : int
        ns, of the pulse of one item.
    min_pause : int
        ns; pulses that are closer become one.
    late_tolerance : int
        ns; a pulse that comes later is a product that may have passed.
    belt_margin : int
        ns, by which a pulse is longer at both ends if the belt stopped before it.

    Attributes
    ----------
    skipped : int
        Pulses that ended before anybody asked `acting` while they lasted.
    """

    def __init__(
        self, duration: int, min_pause: int, late_tolerance: int, belt_margin: int
    ) -> None:
        self._duration = duration
        self._min_pause = min_pause
        self._late_tolerance = late_tolerance
        self._belt_margin = belt_margin
        self._belt = BeltTime()
        self._pulses: list[tuple[int, int]] = []  # begin and end, in the time of the belt
        self._seen = False  # the first of them, acting
        self.skipped = 0

    def belt(self, running: bool, now: int) -> None:
        """Note whether the belt runs; while it stands no pulse begins or ends."""
        if running and self._belt.stopped:
            here, margin = self._belt.at(now), self._belt_margin
            self._belt.run(now)
            pulses = self._pulses
            self._pulses = []
            for begin, end in pulses:
                if end > here:
                    self._put(max(begin - margin, min(begin, here)), end + margin)
        elif not running:
            self._belt.stop(now)

    def add(
        self, due: int | None, since: int | None, now: int, entered: int | None = None
    ) -> int | None:
        """Take a rejected item.

        Parameters
        ----------
        due : int or None
            ns, when its pulse begins if the belt does not stop; None if nobody knows.
        since : int or None
            ns, when the item was where `due` was computed from.
        now : int
            ns.
        entered : int, optional
            ns, when the item was at the infeed eye. If the belt has stood since, its speed by the
            eyes, from which `due` was computed, is too slow by that.

        Returns
        -------
        int or None
            By how many ns the pulse is late, 0 if it is in time; None if `due` is not known: the
            rejector acts at once, but on what?
        """
        here = self._belt.at(now)
        if due is None:
            self._put(here, here + self._duration)
            return None
        begin = self._belt.at(due if since is None else since)
        stood = False
        if since is not None:
            travel = due - since
            if entered is not None and entered < since:
                run = self._belt.at(since) - self._belt.at(entered)
                stood = run < since - entered
                travel = travel * run // (since - entered)
            begin += travel
        late = here - begin
        # What waits for the belt to run gets its margin then.
        delayed = stood or (not self._belt.stopped and begin != self._belt.at(due))
        margin = self._belt_margin if delayed else 0
        if late > self._late_tolerance:
            self._put(here, here + self._duration)
            return late
        self._put(max(begin - margin, min(begin, here)), begin + self._duration + margin)
        return 0

    def _put(self, begin: int, end: int) -> None:
        insort(self._pulses, (begin, end))
        merged = [self._pulses[0]]
        for following, its_end in self._pulses[1:]:
            first, last = merged[-1]
            if following - last < self._min_pause:
                merged[-1] = first, max(last, its_end)
            else:
                merged.append((following, its_end))
        self._pulses = merged

    def acting(self, now: int) -> bool:
        """Tell whether the rejector is to act."""
        here = self._belt.at(now)
        while self._pulses and self._pulses[0][1] <= here:
            del self._pulses[0]
            self.skipped += not self._seen
            self._seen = False
        self._seen = bool(self._pulses) and self._pulses[0][0] <= here
        return self._seen

    def begun(self, now: int) -> bool:
        """Tell whether a pulse has begun that `acting` has not seen the end of."""
        return bool(self._pulses) and self._pulses[0][0] <= self._belt.at(now)

    def next_change(self, now: int) -> int | None:
        """Return when that changes next, ns, None if nothing is to come."""
        acting = self.acting(now)
        return self._belt.when(self._pulses[0][1 if acting else 0]) if self._pulses else None

    def clear(self) -> None:
        """Forget all pulses."""
        self._pulses = []
        self._seen = False

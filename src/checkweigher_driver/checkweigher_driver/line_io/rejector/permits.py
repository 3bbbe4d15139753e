# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Permits to pass the rejector, at most one for each accepted item.

A permit begins shortly before the leading edge of its item is at the rejector, and ends shortly
after the trailing edge. A pause separates two permits, so that a PLC can assign the rising edge of
each permit to one product.
"""

from bisect import insort
import math

from checkweigher_driver.line_io.rejector.reject_pulses import BeltTime


class Permits:
    """Schedule of permits.

    `margin` is the time in ns by which a permit exceeds the passage of its item at both ends.
    `pause` is the shortest time in ns between two permits. A permit that could begin only after the
    arrival of its item is cancelled, because the next item would use it.
    """

    def __init__(self, belt: BeltTime, margin: int, pause: int) -> None:
        self._belt = belt
        self._margin = margin
        self._pause = pause
        self._windows: list[tuple[int, int]] = []  # start and end of each permit in belt time
        self._given = False

    def permit(self, arrival: int, passage: int, now: int) -> bool:
        """Add the permit of an item, and return True.

        If the item is already at the rejector, no permit is added, and the result is False. If a
        permit would end less than a pause before the next permit, it is shortened. `arrival` is the
        belt time in ns at which the item arrives at the rejector, and `passage` is the time in ns
        that the item needs to pass the rejector.
        """
        if arrival < self._belt.at(now):
            return False
        insort(self._windows, (arrival - self._margin, arrival + passage + self._margin))
        pairs = zip(self._windows, [*self._windows[1:], None], strict=True)
        self._windows = [
            (begin, end if after is None else min(end, after[0] - self._pause))
            for (begin, end), after in pairs
        ]
        return True

    def deny(self, arrival: int) -> None:
        """End the permits of earlier items before a rejected item arrives at the rejector.

        `arrival` is the belt time in ns at which the rejected item arrives.
        """
        self._windows = [
            (begin, min(end, arrival - self._pause) if begin < arrival else end)
            for begin, end in self._windows
        ]

    def given(self, now: int) -> bool:
        """Return whether an item is permitted to pass at time `now` in ns."""
        here = self._belt.at(now)
        self._windows = [
            (begin, end)
            for begin, end in self._windows
            if end > here and (self._given or here <= begin + self._margin)
        ]
        self._given = any(begin <= here for begin, _ in self._windows)
        return self._given

    def next_change(self, now: int) -> float:
        """Return the time in ns of the next change of `given`.

        Returns infinity if no change is scheduled, or if the belt is stopped.
        """
        here = self._belt.at(now)
        times = [each for window in self._windows for each in window if each > here]
        return self._belt.when(min(times)) if times else math.inf

    def clear(self) -> None:
        """Cancel all permits."""
        self._windows = []

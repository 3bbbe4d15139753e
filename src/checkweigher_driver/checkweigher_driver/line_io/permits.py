# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Permits to pass the rejector: one for each accepted item, on the time of the belt.

A permit begins shortly before the leading edge of its item is at the rejector, and ends
shortly after the trailing edge. No two of them touch: each begins by a rising edge of its own, so
that a PLC can take one for one product.
"""

from bisect import insort

from checkweigher_driver.line_io.reject_pulses import BeltTime


class Permits:
    """The permits; `margin` at both ends and the shortest `pause` between them in ns.

    One that was not given before its item is there is not given at all: it would be the next one's.
    """

    def __init__(self, belt: BeltTime, margin: int, pause: int) -> None:
        self._belt = belt
        self._margin = margin
        self._pause = pause
        self._windows: list[tuple[int, int]] = []  # begin and end, in the time of the belt
        self._given = False

    def permit(self, arrival: int, passage: int, now: int) -> bool:
        """Let an item pass that is at the rejector from `arrival` on; False if it is there already.

        `arrival` and `passage`, ns, are of the belt.
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
        """End by `arrival` what would let a rejected item pass with the one before it."""
        last = arrival - self._pause
        self._windows = [
            (begin, min(end, last) if begin < arrival else end) for begin, end in self._windows
        ]

    def given(self, now: int) -> bool:
        """Tell whether an item may pass."""
        here = self._belt.at(now)
        self._windows = [(begin, end) for begin, end in self._windows if end > here]
        current = next((begin for begin, _ in self._windows if begin <= here), None)
        if current is None:
            self._given = False
        elif not self._given:
            self._given = here <= current + self._margin
            if not self._given:
                self._windows = [each for each in self._windows if each[0] != current]
        return self._given

    def next_change(self, now: int) -> int | None:
        """Return when `given` changes next, ns; None if nothing is to come."""
        here = self._belt.at(now)
        times = [each for window in self._windows for each in window if each > here]
        return self._belt.when(min(times)) if times else None

    def clear(self) -> None:
        """Let nothing pass."""
        self._windows = []

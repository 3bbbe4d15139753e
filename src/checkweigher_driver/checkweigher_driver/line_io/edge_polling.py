# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges of photo-eyes whose state is polled.

A poll reads both eyes at one unknown moment between its begin and its end. So an edge lies between
the begin of the last poll that saw the old state and the end of the first one that saw the new:
its stamp is the middle, its uncertainty half of that, which is half of period and round trip.
"""

from dataclasses import dataclass

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_driver.sources import EyeEvent, EyesBack, EyesLost


@dataclass(frozen=True, slots=True)
class Poll:
    """State of the eyes (infeed, outfeed), read between two times, ns on a clock without steps."""

    begin: int
    end: int
    blocked: tuple[bool, bool]


class EdgePolling:
    """Find the edges in polls; all times in ns.

    An edge that is less certain than `max_uncertainty` counts as a loss of the eyes, and so does a
    time without a poll in which a product may have passed unseen: `longest_gap`, or what the last
    product covered an eye for, if that is shorter and more than twice `max_uncertainty`. `delay` is
    that from an eye to the state that a poll reads.
    """

    def __init__(self, max_uncertainty: int, longest_gap: int, delay: int) -> None:
        self._max_uncertainty = max_uncertainty
        self._longest_gap = longest_gap
        self._delay = delay
        self._last: Poll | None = None
        self._lost = False
        self._blocked_at: dict[Eye, int] = {}
        self._covered: dict[Eye, int] = {}  # ns, by the last product
        self.uncertainty = self.worst_uncertainty = 0  # of the last edge, of all that were taken
        self.losses = 0

    def add(self, poll: Poll, to_stamp: int) -> list[EyeEvent]:
        """Take a poll and return the edges or the loss that it shows.

        `to_stamp` is stamp less time of the polls, ns.
        """
        last, self._last = self._last, poll
        to_stamp -= self._delay
        if self._lost:
            self._lost = False
            return [EyesBack(poll.end + to_stamp)]
        if last is None:
            return []
        uncertainty = (poll.end - last.begin) // 2
        edge_in_doubt = poll.blocked != last.blocked and uncertainty > self._max_uncertainty
        if edge_in_doubt or poll.end - last.begin > self._unseen:
            self.losses += 1
            self._blocked_at.clear()
            text = f'the photo-eyes were not read for {1e-6 * (poll.end - last.begin):.1f} ms'
            return [EyesLost(last.begin + to_stamp, text), EyesBack(poll.end + to_stamp)]
        if poll.blocked == last.blocked:
            return []
        self.uncertainty = uncertainty
        self.worst_uncertainty = max(self.worst_uncertainty, uncertainty)
        stamp = last.begin + uncertainty + to_stamp
        changed = [
            eye for eye in (Eye.INFEED, Eye.OUTFEED) if poll.blocked[eye] != last.blocked[eye]
        ]
        for eye in changed:
            middle = last.begin + uncertainty
            if poll.blocked[eye]:
                self._blocked_at[eye] = middle
            elif eye in self._blocked_at:
                self._covered[eye] = middle - self._blocked_at.pop(eye)
        return [EyeEdge(stamp, eye, poll.blocked[eye]) for eye in changed]

    @property
    def _unseen(self) -> int:
        """Time without a poll from which on a product may have passed unseen, ns."""
        covered = max(
            min(self._covered.values(), default=self._longest_gap), 2 * self._max_uncertainty
        )
        return min(self._longest_gap, covered)

    def lose(self, now: int, to_stamp: int, text: str) -> list[EyeEvent]:
        """Note that polls fail; return the loss once, until a poll succeeds."""
        if self._lost:
            return []
        self._lost = True
        self.losses += 1
        self._blocked_at.clear()
        since = now if self._last is None else self._last.begin
        return [EyesLost(since + to_stamp - self._delay, text)]

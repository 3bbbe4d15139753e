# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges of photo-eyes whose state is polled.

A poll reads both eyes at one unknown moment between its begin and its end. So an edge lies between
the begin of the last poll that saw the old state and the end of the first one that saw the new:
its stamp is the middle, its uncertainty half of that, which is half of period and round trip.
"""

from dataclasses import dataclass

from checkweigher_driver.sources import EyeEvent, EyesBack, EyesLost
from checkweigher_dsp.records import Eye, EyeEdge


@dataclass(frozen=True, slots=True)
class Poll:
    """State of the eyes (infeed, outfeed), read between two times, ns on a clock without steps."""

    begin: int
    end: int
    blocked: tuple[bool, bool]


class EdgePolling:
    """Find the edges in polls; all times in ns.

    An edge that is less certain than `max_uncertainty` counts as a loss of the eyes, and so does a
    time of `longest_gap` without a poll, in which a product may have passed unseen. `delay` is that
    from an eye to the state that a poll reads.
    """

    def __init__(self, max_uncertainty: int, longest_gap: int, delay: int) -> None:
        self._max_uncertainty = max_uncertainty
        self._longest_gap = longest_gap
        self._delay = delay
        self._last: Poll | None = None
        self._lost = False
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
        if edge_in_doubt or poll.end - last.begin > self._longest_gap:
            self.losses += 1
            text = f'the photo-eyes were not read for {1e-6 * (poll.end - last.begin):.1f} ms'
            return [EyesLost(last.begin + to_stamp, text), EyesBack(poll.end + to_stamp)]
        if poll.blocked == last.blocked:
            return []
        self.uncertainty = uncertainty
        self.worst_uncertainty = max(self.worst_uncertainty, uncertainty)
        stamp = last.begin + uncertainty + to_stamp
        return [
            EyeEdge(stamp, eye, poll.blocked[eye])
            for eye in (Eye.INFEED, Eye.OUTFEED)
            if poll.blocked[eye] != last.blocked[eye]
        ]

    def lose(self, now: int, to_stamp: int, text: str) -> list[EyeEvent]:
        """Take that polls fail; return the loss once, until a poll succeeds."""
        if self._lost:
            return []
        self._lost = True
        self.losses += 1
        since = now if self._last is None else self._last.begin
        return [EyesLost(since + to_stamp - self._delay, text)]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges of photo-eyes whose states are polled.

A poll reads both eyes at an unknown time between its start and its end. An edge therefore lies
between the start of the last poll with the old state and the end of the first poll with the new
state. The stamp of the edge is the middle of this interval, and its uncertainty is half of the
interval. The length of the interval is the sum of poll period and round-trip time.
"""

from dataclasses import dataclass

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_driver.sources import EyeEvent, EyesBack, EyesLost


@dataclass(frozen=True, slots=True)
class Poll:
    """States of infeed and outfeed eye, read between monotonic times `begin` and `end` in ns."""

    begin: int
    end: int
    blocked: tuple[bool, bool]


class EdgePolling:
    """Detector of edges in polls of the photo-eyes. All times are in ns.

    An edge whose uncertainty exceeds `max_uncertainty` counts as a loss of the eyes. A time without
    polls in which a product may have passed also counts as a loss. The longest allowed time without
    polls is the shorter of the times for which the last product covered the two eyes, but at least
    twice `max_uncertainty` and at most `longest_gap`. Before the first product, the longest allowed
    time is `longest_gap`. `delay` is the time from an edge to the first poll that can show it.
    """

    def __init__(self, max_uncertainty: int, longest_gap: int, delay: int) -> None:
        self._max_uncertainty = max_uncertainty
        self._longest_gap = longest_gap
        self._delay = delay
        self._last: Poll | None = None
        self._lost = False
        self._blocked_at: dict[Eye, int] = {}
        self._covered: dict[Eye, int] = {}  # time in ns for which the last product covered an eye
        self._worst_uncertainty = 0  # largest uncertainty in ns of an edge so far
        self.losses = 0
        self._polls = self._periods = self._round_trips = self._longest_round_trip = 0

    def add(self, poll: Poll, to_stamp: int) -> list[EyeEvent]:
        """Add a poll; return the edges since the previous poll.

        If an edge is too uncertain or a product may have passed unnoticed, the start and the end of
        a loss of the eyes are returned instead. After a failed poll, only the end of the loss is
        returned. The first poll shows no edges. `to_stamp` is the time in ns on the clock of the
        stamps minus the time on the clock of the polls.
        """
        last, self._last = self._last, poll
        to_stamp -= self._delay
        if self._lost:
            self._lost = False
            return [EyesBack(poll.end + to_stamp)]
        if last is None:
            return []
        self._count(last, poll)
        changed = [eye for eye in Eye if poll.blocked[eye] != last.blocked[eye]]
        unseen = poll.end - last.begin
        uncertainty = unseen // 2
        if unseen > self._longest_unseen or (changed and uncertainty > self._max_uncertainty):
            self.losses += 1
            self._blocked_at.clear()
            text = f'the photo-eyes were not read for {1e-6 * unseen:.1f} ms'
            return [EyesLost(last.begin + to_stamp, text), EyesBack(poll.end + to_stamp)]
        middle = last.begin + uncertainty
        for eye in changed:
            self._worst_uncertainty = max(self._worst_uncertainty, uncertainty)
            self._cover(eye, poll.blocked[eye], middle)
        return [EyeEdge(middle + to_stamp, eye, poll.blocked[eye]) for eye in changed]

    def _count(self, last: Poll, poll: Poll) -> None:
        self._polls += 1
        self._periods += poll.begin - last.begin
        self._round_trips += poll.end - poll.begin
        self._longest_round_trip = max(self._longest_round_trip, poll.end - poll.begin)

    def _cover(self, eye: Eye, blocked: bool, time: int) -> None:
        if blocked:
            self._blocked_at[eye] = time
        elif eye in self._blocked_at:
            self._covered[eye] = time - self._blocked_at.pop(eye)

    @property
    def _longest_unseen(self) -> int:
        """Longest allowed time in ns without polls, in which no product can pass unnoticed."""
        covered = min(self._covered.values(), default=self._longest_gap)
        return min(self._longest_gap, max(covered, 2 * self._max_uncertainty))

    def lose(self, now: int, to_stamp: int, text: str) -> list[EyeEvent]:
        """Return the loss of the eyes after a failed poll, or an empty list during a loss.

        `now` is the time at which the failed poll began, `to_stamp` is the same difference as in
        `add`, and `text` is the reason of the failure.
        """
        if self._lost:
            return []
        self._lost = True
        self.losses += 1
        self._blocked_at.clear()
        since = now if self._last is None else self._last.begin
        return [EyesLost(since + to_stamp - self._delay, text)]

    def figures(self) -> dict[str, float]:
        """Return values for the diagnostics, by name.

        ``edge uncertainty ms`` is computed from the mean period and round-trip time. ``largest edge
        uncertainty ms`` is the maximum over all edges.
        """
        polls = max(self._polls, 1)
        period, round_trip = 1e-6 * self._periods / polls, 1e-6 * self._round_trips / polls
        return {
            'polls': self._polls,
            'poll period ms': period,
            'round trip ms': round_trip,
            'longest round trip ms': 1e-6 * self._longest_round_trip,
            'edge uncertainty ms': (period + round_trip) / 2,
            'largest edge uncertainty ms': 1e-6 * self._worst_uncertainty,
            'eye losses': self.losses,
        }

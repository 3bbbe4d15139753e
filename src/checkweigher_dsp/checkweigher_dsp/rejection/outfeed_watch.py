# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Detection of items that leave the belt while the segmenter is delayed or has ended."""

from collections import deque
from dataclasses import dataclass
import math

from checkweigher_core.records import Eye, EyeEdge, Item

# Shortest time in ns for which an eye is clear between two items, longer than usual debounce times.
FLICKER = 20_000_000
_MOST = 1_000  # maximum number of stored edges and items


@dataclass(frozen=True, slots=True)
class OutfeedEdge:
    """Edge at which an item began to leave."""

    stamp: int  # time stamp of the edge in ns.
    # Time in ns on the clock of arrivals at which the edge would have arrived without a delay.
    came: int
    after: int  # largest known item number when the edge arrived


class OutfeedWatch:
    """Watch of the outfeed edges for items that leave without an announcement. Stamps are in ns."""

    def __init__(self) -> None:
        # Outfeed edges that the segmenter has not processed and that belong to no announced item.
        self.open: list[OutfeedEdge] = []
        self._explained: deque[int] = deque(maxlen=_MOST)
        self.restart()

    def restart(self) -> None:
        """Begin a new stream, in which the segmenter has not processed any edge."""
        self._taken: tuple[float, float] = (math.inf, -math.inf)
        self._clear_since = -math.inf
        self._stamps: deque[int] = deque(maxlen=4 * _MOST)  # stamps of all edges.
        # Times t1 and t3 in ns of items whose verdict was given before their last announcement.
        self._judged: deque[tuple[int | None, int]] = deque(maxlen=_MOST)

    def add(self, edge: EyeEdge, came: int, after: int) -> None:
        """Add an edge that has just arrived.

        `came` is the time in ns at which the edge would have arrived without a delay. `after` is
        the largest item number so far.
        """
        self._stamps.append(edge.stamp)
        if edge.eye != Eye.OUTFEED:
            return
        if not edge.blocked:
            self._clear_since = edge.stamp
            return
        if 0 <= edge.stamp - self._clear_since < FLICKER:
            return
        if edge.stamp in self._explained or self._is_taken(edge.stamp):
            return
        self.open = [*self.open, OutfeedEdge(edge.stamp, came, after)][-_MOST:]

    def explain(self, t3: int | None) -> None:
        """Remove the edge of an announced item, or ignore this edge if it arrives later.

        `t3` is the stamp of the edge, or None if the item has no such edge.
        """
        if t3 is not None:
            self._explained.append(t3)
            self.remove(t3)

    def has_seen(self, t3: int | None) -> bool:
        """Return whether an edge with this stamp has arrived in this stream."""
        return t3 in self._stamps

    def take_to(self, stamp: int, count: int) -> None:
        """Remove the last `count` edges up to a stamp, because the segmenter has processed them."""
        first = -math.inf
        # If the segmenter was started after the first edges, it has not processed these edges.
        if 0 < count < len(self._stamps):
            known = sorted(each for each in self._stamps if each <= stamp)
            first = known[-count] if count < len(known) else first
        self._taken = first, stamp
        self.open = [each for each in self.open if not self._is_taken(each.stamp)]

    def remove(self, stamp: int) -> None:
        """Remove the edge with the given stamp."""
        self.open = [each for each in self.open if each.stamp != stamp]

    def judge(self, t1: int | None, t3: int) -> None:
        """Store t1 and t3 in ns of an item whose verdict is given before its last announcement.

        If t1 is unknown, `t1` is None.
        """
        self._judged.append((t1, t3))

    def has_judged(self, item: Item) -> bool:
        """Return whether an item received a verdict by its edges before its last announcement."""
        return any(
            (item.t1 is not None and item.t1 == t1) or (item.t3 is not None and item.t3 == t3)
            for t1, t3 in self._judged
        )

    def _is_taken(self, stamp: int) -> bool:
        first, last = self._taken
        return first <= stamp <= last

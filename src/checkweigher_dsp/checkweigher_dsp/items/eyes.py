# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""State of the photo-eyes, with checks for repeated edges, chatter and start-up."""

from collections import OrderedDict
from dataclasses import dataclass, replace

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_dsp.items.item import TrackedItem

_LONG_AGO = -(2**62)  # time in ns before any stamp
_REMEMBERED = 64  # number of edges that are kept to detect repeated edges


@dataclass(slots=True)
class Switch:
    """Edge of an eye, with the previous edge and the item that was at the eye."""

    stamp: int  # time in ns
    previous: EyeEdge | None  # previous edge of the same eye, or None if there is none
    there: TrackedItem | None  # known item that blocked the eye before this edge, or None
    blocked: bool  # whether the eye is blocked after this edge


class Eyes:
    """Latest edges of both eyes. See `ItemTracker` for the parameters."""

    def __init__(self, debounce: int, max_transit: int) -> None:
        self.debounce = debounce
        self.origin: int | None = None  # time of the first sample of the stream in ns
        self.newest: int | None = None  # largest stamp in ns since the clock last jumped back
        self._max_transit = max_transit
        # Recent edges, in a dictionary because it is faster to search than a deque.
        self._known: OrderedDict[EyeEdge, None] = OrderedDict()
        self.youngest: dict[Eye, EyeEdge] = {}  # edge of each eye with the largest stamp
        self.latest: dict[Eye, EyeEdge] = {}  # edge of each eye that arrived last
        self._first: dict[Eye, int] = {}

    @property
    def any_blocked(self) -> bool:
        """Whether at least one eye is blocked."""
        return any(edge.blocked for edge in self.youngest.values())

    def is_new(self, edge: EyeEdge) -> bool:
        """Store an edge, and return whether it differs from each of the last 64 edges."""
        if edge in self._known:
            return False
        self._known[edge] = None
        if len(self._known) > _REMEMBERED:
            self._known.popitem(last=False)
        return True

    def take(self, edge: EyeEdge) -> EyeEdge | None:
        """Store an edge as the youngest of its eye, and return the previous youngest, or None."""
        previous = self.youngest.get(edge.eye)
        self.youngest[edge.eye] = self.latest[edge.eye] = edge
        self._first.setdefault(edge.eye, edge.stamp)
        return previous

    def flickers(self, switch: Switch) -> bool:
        """Return whether an edge follows the previous edge so soon that it is chatter.

        The limit is the debounce time. If both edges have the same direction, the limit is twice
        the debounce time, because an edge between them was lost. The result is False without a
        previous edge.
        """
        previous = switch.previous
        if previous is None:
            return False
        longest = self.debounce * (2 if previous.blocked == switch.blocked else 1)
        return 0 <= switch.stamp - previous.stamp < longest

    def shows_state(self, stamp: int) -> bool:
        """Return whether an eye that clears at `stamp`, in ns, only shows its initial state.

        The caller must ensure that this clearing edge is the first edge of the eye. The edge only
        shows the initial state if it is less than `max_transit` before or at most `debounce` after
        the first sample. An edge within `debounce` of the first edge of the other eye also only
        shows the initial state.
        """
        if self.origin is not None and -self._max_transit < stamp - self.origin <= self.debounce:
            return True
        both = len(self._first) > 1
        return both and abs(self._first[Eye.INFEED] - self._first[Eye.OUTFEED]) <= self.debounce

    def forget_clock(self) -> None:
        """Discard the recent edges and the times of the youngest edges, as the clock has changed.

        The states of both eyes and the times of their first edges are kept.
        """
        self._known.clear()
        self.latest.clear()
        for eye, edge in self.youngest.items():
            self.youngest[eye] = replace(edge, stamp=_LONG_AGO)
        self.newest = None

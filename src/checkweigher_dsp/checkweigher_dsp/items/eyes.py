# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes: repeated edges, chatter, and edges that only show the state at start-up."""

from collections import OrderedDict
from dataclasses import dataclass, replace

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_dsp.items.item import TrackedItem

_LONG_AGO = -(2**62)  # ns
_REMEMBERED = 64  # latest edges, to detect one that comes twice


@dataclass(slots=True)
class Switch:
    """Change of the state of an eye."""

    stamp: int  # ns
    previous: EyeEdge | None  # of the same eye
    there: TrackedItem | None  # the item that blocked this eye until now
    blocked: bool  # whether an item blocks the eye now


class Eyes:
    """Latest edges of both eyes; `debounce` and `max_transit` in ns, as in `ItemTracker`."""

    def __init__(self, debounce: int, max_transit: int) -> None:
        self.debounce = debounce
        self.origin: int | None = None  # ns, start of the stream, when an eye may show its state
        self.newest: int | None = None  # ns, stamp of the youngest edge by the present clock
        self._max_transit = max_transit
        self._known: OrderedDict[EyeEdge, None] = OrderedDict()  # faster to search than a deque
        self.youngest: dict[Eye, EyeEdge] = {}
        self.latest: dict[Eye, EyeEdge] = {}  # by arrival, late ones included
        self._first: dict[Eye, int] = {}

    @property
    def any_blocked(self) -> bool:
        """Whether an eye is blocked."""
        return any(edge.blocked for edge in self.youngest.values())

    def is_new(self, edge: EyeEdge) -> bool:
        """Record an edge and return whether it is new."""
        if edge in self._known:
            return False
        self._known[edge] = None
        if len(self._known) > _REMEMBERED:
            self._known.popitem(last=False)
        return True

    def take(self, edge: EyeEdge) -> EyeEdge | None:
        """Store the youngest edge of an eye and return the previous one."""
        previous = self.youngest.get(edge.eye)
        self.youngest[edge.eye] = self.latest[edge.eye] = edge
        self._first.setdefault(edge.eye, edge.stamp)
        return previous

    def flickers(self, switch: Switch) -> bool:
        """Return whether an edge is chatter: too soon after the previous one of its eye.

        If the edge between them was lost, the limit is twice the debounce time.
        """
        previous = switch.previous
        if previous is None:
            return False
        longest = self.debounce * (2 if previous.blocked == switch.blocked else 1)
        return 0 <= switch.stamp - previous.stamp < longest

    def shows_state(self, stamp: int) -> bool:
        """Return whether the first edge of an eye, a clearing one, only shows its initial state.

        Such an edge is near the first sample, or within `debounce` of the first edge of the other
        eye.
        """
        if self.origin is not None and -self._max_transit < stamp - self.origin <= self.debounce:
            return True
        both = len(self._first) > 1
        return both and abs(self._first[Eye.INFEED] - self._first[Eye.OUTFEED]) <= self.debounce

    def forget_clock(self) -> None:
        """Discard all stamps, because the clock has changed.

        The states of the eyes are kept, but later edges are not compared with earlier ones.
        """
        self._known.clear()
        self.latest.clear()
        for eye, edge in self.youngest.items():
            self.youngest[eye] = replace(edge, stamp=_LONG_AGO)
        self.newest = None

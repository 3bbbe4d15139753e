# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes: edges that are new, late, chatter or only a state at start-up."""

from collections import OrderedDict
from dataclasses import dataclass, replace

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_dsp.items.item import TrackedItem

_LONG_AGO = -(2**62)  # ns
_REMEMBERED = 64  # edges, among which one that comes twice is recognized


@dataclass(slots=True)
class Switch:
    """One switching of an eye."""

    stamp: int  # ns
    previous: EyeEdge | None  # of the same eye
    there: TrackedItem | None  # the item that blocked this eye until now
    blocked: bool  # whether an item blocks the eye now


class Eyes:
    """The latest edges of both eyes; `debounce` and `max_transit` in ns, as in `ItemTracker`."""

    def __init__(self, debounce: int, max_transit: int) -> None:
        self.debounce = debounce
        # ns, when the stream began: an eye that clears then shows its state.
        self.origin: int | None = None
        self.newest: int | None = None  # ns, stamp of the youngest edge
        self._max_transit = max_transit
        self._known: OrderedDict[EyeEdge, None] = OrderedDict()  # the latest, a set
        self.youngest: dict[Eye, EyeEdge] = {}
        self.latest: dict[Eye, EyeEdge] = {}  # that came last, perhaps late
        self._first: dict[Eye, int] = {}

    @property
    def any_blocked(self) -> bool:
        """Whether an eye is blocked."""
        return any(edge.blocked for edge in self.youngest.values())

    def knows(self, edge: EyeEdge) -> bool:
        """Tell whether an edge has come before."""
        return edge in self._known

    def is_new(self, edge: EyeEdge) -> bool:
        """Tell whether an edge has not come before, and remember it."""
        if edge in self._known:
            return False
        self._known[edge] = None
        if len(self._known) > _REMEMBERED:
            self._known.popitem(last=False)
        return True

    def take(self, edge: EyeEdge) -> EyeEdge | None:
        """Take an edge as the youngest of its eye; return the one that was so before."""
        previous = self.youngest.get(edge.eye)
        self.youngest[edge.eye] = self.latest[edge.eye] = edge
        self._first.setdefault(edge.eye, edge.stamp)
        return previous

    def flickers(self, switch: Switch) -> bool:
        """Tell whether an edge is chatter; where the one between was lost, for twice as long."""
        previous = switch.previous
        if previous is None:
            return False
        longest = self.debounce * (2 if previous.blocked == switch.blocked else 1)
        return 0 <= switch.stamp - previous.stamp < longest

    def shows_state(self, stamp: int) -> bool:
        """Tell whether the first edge of an eye, one that clears, only shows its state at start-up.

        That comes with the first sample or together with the state of the other eye.
        """
        if self.origin is not None:
            after = stamp - self.origin
            if -self._max_transit < after <= self.debounce:
                return True
        return len(self._first) > 1 and (
            abs(self._first[Eye.INFEED] - self._first[Eye.OUTFEED]) <= self.debounce
        )

    def forget_clock(self) -> None:
        """Forget all stamps: the edges come again, by another clock.

        Whether an eye is blocked still holds, but no edge is chatter of it.
        """
        self._known.clear()
        self.latest.clear()
        for eye, edge in self.youngest.items():
            self.youngest[eye] = replace(edge, stamp=_LONG_AGO)
        self.newest = None

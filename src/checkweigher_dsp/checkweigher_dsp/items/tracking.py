# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""TrackedItem tracking: photo-eye edges become items, and some items become faults by them.

The four edges of an item are t1 (infeed blocked: it begins to enter), t2 (infeed clears: fully on
the belt), t3 (outfeed blocked: begins to leave) and t4 (outfeed clears: gone).
"""

from collections.abc import Callable

from checkweigher_core.records import EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.belt import Belt, UsualTransit
from checkweigher_dsp.items.eyes import Eyes
from checkweigher_dsp.items.item import TrackedItem
from checkweigher_dsp.items.transitions import (
    apply_edge,
    apply_late_edge,
    settle,
    settle_first,
)


class ItemTracker:
    """Pair the edges of the two eyes to items, which leave in the order in which they entered.

    Where an edge is missing, the time that the last whole item took from eye to eye decides which
    item an edge belongs to, so that one lost edge costs one item and not all that follow. The rules
    are the table in `checkweigher_dsp.items.transitions`.

    An eye that clears for less than `debounce`, ns, has not cleared, and has chattered. An item
    that has not reached the outfeed eye within `max_transit`, ns, never will. The belt is
    `belt_lengths` products long, 0 if that is not known; `count` items were there before.
    `unloaded` is what the scale shows, see `Belt`.
    """

    def __init__(
        self, debounce: int, max_transit: int, count: int = 0, belt_lengths: float = 0.0,
        unloaded: Callable[[int, int], bool] = lambda since, stamp: False,
    ) -> None:  # fmt: skip
        self._max_transit = max_transit
        self._eyes = Eyes(debounce, max_transit)
        self._belt = Belt(self._eyes, UsualTransit(max_transit, belt_lengths), count, unloaded)
        self._settled: list[TrackedItem] = []

    @property
    def usual_transit(self) -> int | None:
        """Time that the last whole item took from eye to eye, ns; None if there is none."""
        return self._belt.transit.value

    @property
    def count(self) -> int:
        """Number of items so far."""
        return self._belt.count

    @property
    def newest(self) -> int | None:
        """Stamp of the youngest edge, ns; None if there is none by this clock."""
        return self._eyes.newest

    @property
    def is_empty(self) -> bool:
        """Whether no item is on the belt and both eyes are clear, by what they have shown."""
        belt = self._belt
        at_an_eye = belt.at_infeed is not None or self._eyes.any_blocked
        return not (belt.items or at_an_eye or belt.cleared_first is not None)

    @property
    def empty_since(self) -> int | None:
        """Time at which the last item had left, ns; None if none was there."""
        newest = self._eyes.newest
        return None if newest is None else self._belt.last_departure(newest)

    @property
    def overdue_after(self) -> int | None:
        """Time until which the next item may yet come to the outfeed eye, ns; None if empty."""
        belt = self._belt
        if belt.cleared_first is not None:
            return belt.cleared_first + self._max_transit
        return belt.items[0].entered + self._max_transit if belt.items else None

    def begin(self, origin: int | None) -> None:
        """Take when the stream began, ns: an eye that clears then shows its state, no item."""
        self._eyes.origin = origin

    def knows(self, edge: EyeEdge) -> bool:
        """Tell whether an edge has come before."""
        return self._eyes.knows(edge)

    def add(self, edge: EyeEdge) -> list[TrackedItem]:
        """Take one edge and return the items that it finishes: at t3, or given up."""
        self._expire(edge.stamp)
        self.settle(edge.stamp)
        if self._eyes.is_new(edge):
            newest = self._eyes.newest
            if newest is not None and edge.stamp < newest:
                apply_late_edge(self._belt, edge)
            else:
                self._eyes.newest = edge.stamp
                apply_edge(self._belt, edge)
        self.settle(edge.stamp)
        return self._belt.take_finished()

    def settle(self, stamp: int) -> None:
        """Settle which items have entered, once no edge after `stamp` can change their number."""
        self._settled += [item.snapshot() for item in settle(self._belt, stamp)]

    def take_settled(self) -> list[TrackedItem]:
        """Return the items that have been settled since the last call, as they were then."""
        settled, self._settled = self._settled, []
        return settled

    def expire(self, stamp: int) -> list[TrackedItem]:
        """Return the items that must have left by `stamp` without the outfeed eye seeing them."""
        self._expire(stamp)
        self.settle(stamp)
        return self._belt.take_finished()

    def _expire(self, stamp: int) -> None:
        first = self._belt.cleared_first
        if first is not None and stamp - first > self._max_transit:
            settle_first(self._belt)
        self._belt.expire(stamp)

    def give_up(self, reason: Reason) -> list[TrackedItem]:
        """Return all items still on the belt, with `reason`: nothing more will come."""
        settle_first(self._belt)
        self._belt.abandon(reason)
        if self._eyes.newest is not None:
            self.settle(self._eyes.newest)
        return self._belt.take_finished()

    def forget(self, *, backwards: bool = True) -> None:
        """Forget all times, and the edges if the clock may have gone back: they come again."""
        self._belt.forget_clock(backwards=backwards)

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Item tracking, which assigns photo-eye edges to items.

An item blocks the infeed eye at t1, when it begins to enter, and clears this eye at t2, when it is
fully on the belt. The item blocks the outfeed eye at t3, when it begins to leave, and clears this
eye at t4, when it has left.
"""

from collections.abc import Callable

from checkweigher_core.records import EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.belt import Belt, UsualTransit
from checkweigher_dsp.items.departures import last_departure
from checkweigher_dsp.items.eyes import Eyes
from checkweigher_dsp.items.item import TrackedItem
from checkweigher_dsp.items.transitions import apply_edge, apply_late_edge, settle, settle_first


class ItemTracker:
    """Assignment of the edges of two eyes to items, which leave in the order of their entry.

    If an edge is missing, the tracker assigns the next outfeed edge to the item whose transit fits
    the usual transit best, so that a lost edge affects only one item. An item that is given up is
    reported as a fault without t3. The rules are a table in `checkweigher_dsp.items.transitions`.

    An eye that clears for less than `debounce`, in ns, chatters. An item that has not reached the
    outfeed eye after `max_transit`, in ns, is given up. `count` is the number of the last item
    before this tracker was created, or 0. `belt_lengths` is the length of the belt divided by the
    length of a product, or 0 if the length of a product is unknown. See `Belt` for `unloaded`.
    """

    def __init__(
        self,
        debounce: int,
        max_transit: int,
        count: int = 0,
        belt_lengths: float = 0.0,
        unloaded: Callable[[int, int], bool] = lambda since, stamp: False,
    ) -> None:
        self.eyes = Eyes(debounce, max_transit)
        self.belt = Belt(self.eyes, UsualTransit(max_transit, belt_lengths), count, unloaded)
        self._settled: list[TrackedItem] = []

    @property
    def is_empty(self) -> bool:
        """Whether no item is on the belt and both eyes are clear."""
        belt = self.belt
        on_belt = belt.items or belt.at_infeed or belt.cleared_first is not None
        return not (on_belt or self.eyes.any_blocked)

    @property
    def empty_since(self) -> int | None:
        """Time in ns at which the last item left the belt.

        The time is None if no item is known to have left since the clock last changed.
        """
        newest = self.eyes.newest
        return None if newest is None else last_departure(self.belt, newest)

    def add(self, edge: EyeEdge) -> list[TrackedItem]:
        """Assign an edge to an item, and return the items that are finished or given up.

        A repeated edge is not assigned.
        """
        finished = self.expire(edge.stamp)
        if self.eyes.is_new(edge):
            newest = self.eyes.newest
            if newest is not None and edge.stamp < newest:
                apply_late_edge(self.belt, edge)
            else:
                self.eyes.newest = edge.stamp
                apply_edge(self.belt, edge)
        self._settle(edge.stamp)
        return finished + self.belt.take_finished()

    def _settle(self, stamp: int) -> None:
        self._settled += [item.snapshot() for item in settle(self.belt, stamp)]

    def take_settled(self) -> list[TrackedItem]:
        """Return copies of the items whose numbers have become final since the last call."""
        settled, self._settled = self._settled, []
        return settled

    def expire(self, stamp: int) -> list[TrackedItem]:
        """Give up the items that entered more than `max_transit` before `stamp`, in ns.

        Returns the items that are given up.
        """
        first = self.belt.cleared_first
        if first is not None and stamp - first > self.belt.transit.max_transit:
            settle_first(self.belt)
        self.belt.expire(stamp)
        self._settle(stamp)
        return self.belt.take_finished()

    def give_up(self, reason: Reason) -> list[TrackedItem]:
        """Give up all items on the belt as faults with a reason, and return them."""
        settle_first(self.belt)
        self.belt.abandon(reason)
        if self.eyes.newest is not None:
            self._settle(self.eyes.newest)
        return self.belt.take_finished()

    def forget(self, *, backwards: bool = True) -> None:
        """Discard the departure times and the usual transit, because the clock has changed.

        The times of the edges are discarded as well if the clock may have gone `backwards`.
        """
        self.belt.forget_clock(backwards=backwards)

"""Which photo-eye edges belong to which item, and which items cannot be weighed for it.

The four edges of an item are t1 (infeed blocked: it begins to enter), t2 (infeed clears: fully on
the belt), t3 (outfeed blocked: begins to leave) and t4 (outfeed clears: gone).
"""

from collections import OrderedDict, deque
from dataclasses import replace

from checkweigher_dsp.items.belt_items import BeltItems
from checkweigher_dsp.items.item import Item, departure, length
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import Eye, EyeEdge

_LONG_AGO = -(2**62)  # ns
_REMEMBERED = 64  # edges, in which one that comes twice is known again
_FLICKERS = 2  # debounce times, for which an eye may chatter where an item ends


class ItemTracker(BeltItems):
    """Pair the edges of the two eyes to items, which leave in the order in which they entered.

    Where an edge is missing the time that the last whole item took from eye to eye tells which item
    an edge belongs to, so that one lost edge costs one item and not all that follow.

    Parameters
    ----------
    debounce : int
        ns; an eye that clears for less has not cleared, and has chattered.
    max_transit : int
        ns; an item that has not reached the outfeed eye by then never will.
    count : int
        Items that were there before.
    belt_lengths : float
        Length of the belt in lengths of a product; 0 if not known.
    """

    def __init__(
        self, debounce: int, max_transit: int, count: int = 0, belt_lengths: float = 0.0
    ) -> None:
        super().__init__(debounce, max_transit, count, belt_lengths)
        self.origin: int | None = None  # when the stream began: an eye tells its state then
        self._last_edge: dict[Eye, EyeEdge] = {}
        self._edges: OrderedDict[EyeEdge, None] = OrderedDict()  # the latest, a set
        self._newest: int | None = None  # stamp of an edge
        self._came_last: dict[Eye, EyeEdge] = {}
        self._other_clock = False  # that of the last edge of the infeed eye
        self._first_edge: dict[Eye, int] = {}
        self._cleared_first: int | None = None  # the infeed eye, before it was blocked
        self._runs_on = False  # the belt, with what has been given up: the clock alone has jumped

    @property
    def is_empty(self) -> bool:
        """Whether no item is on the belt and both eyes are clear, as far as they tell."""
        blocked = any(edge.blocked for edge in self._last_edge.values())
        return not (self._on_belt or self._entering or blocked or self._cleared_first is not None)

    @property
    def empty_since(self) -> int | None:
        """When the last item had left, ns; None if none was there."""
        return None if self._newest is None else self._last_departure(self._newest)

    @property
    def overdue_after(self) -> int | None:
        """Until when the next item to leave may yet come to the outfeed eye, ns; None if empty."""
        if self._cleared_first is not None:
            return self._cleared_first + self._max_transit
        return self._on_belt[0].entered + self._max_transit if self._on_belt else None

    def knows(self, edge: EyeEdge) -> bool:
        """Tell whether an edge has come before."""
        return edge in self._edges

    def add(self, edge: EyeEdge) -> list[Item]:
        """Take one edge and return the items that it finishes: at t3, or given up."""
        self._expire(edge.stamp)
        if edge not in self._edges:
            self._edges[edge] = None
            if len(self._edges) > _REMEMBERED:
                self._edges.popitem(last=False)
            if self._newest is not None and edge.stamp < self._newest:
                self._add_late(edge)
            else:
                self._newest = edge.stamp
                self._switch(edge)
        return self._take_finished()

    def _switch(self, edge: EyeEdge) -> None:
        previous = self._last_edge.get(edge.eye)
        self._last_edge[edge.eye] = edge
        self._came_last[edge.eye] = edge
        self._first_edge.setdefault(edge.eye, edge.stamp)
        self._settle_first()
        if edge.eye == Eye.INFEED:
            if edge.blocked:
                self._infeed_blocked(edge.stamp, previous)
            else:
                self._infeed_clears(edge.stamp, previous)
            self._other_clock = False
            return
        self._merge_flicker()
        if edge.blocked:
            self._outfeed_blocked(edge.stamp, previous)
        else:
            self._outfeed_clears(edge.stamp, previous)

    def _add_late(self, edge: EyeEdge) -> None:
        """Take an edge that comes after a younger one: nothing on the belt can be trusted."""
        self._settle_first()
        self._doubt_all()
        came = self._came_last.get(edge.eye)
        self._came_last[edge.eye] = edge
        if came is not None and self._flickers(edge.stamp, came, blocked=edge.blocked):
            return
        last = self._last_edge.get(edge.eye)
        item = self._entered_last
        clears = edge.eye == Eye.INFEED and not edge.blocked
        own = item is not None and last is not None and item.t1 == last.stamp < edge.stamp
        if clears and own and item is not None:  # also of one that has left meanwhile
            item.t2, self._entering, self._last_edge[edge.eye] = edge.stamp, None, edge
            return
        if edge.eye == Eye.INFEED and edge.blocked and self._is_known(edge):
            return
        if clears and self._complete_infeed(edge.stamp):
            return
        if last is None or edge.stamp >= last.stamp:
            self._switch(edge)
            self._doubt_all()
        elif edge.eye == Eye.OUTFEED:
            self._complete_outfeed(edge)
        elif not edge.blocked:
            item = self._entering
            chatters = item is not None and Reason.CHATTERING_EYE in item.faults
            if item is not None and item.t1 is not None and item.t1 < edge.stamp and not chatters:
                item.t2, self._entering = edge.stamp, None
        else:
            item = self._begun = self._new_item()
            item.t1 = item.given_up = edge.stamp
            item.fault(Reason.LATE_EDGE)
            self._finished.append(item)
            self._given_up.append(item)

    def expire(self, stamp: int) -> list[Item]:
        """Return the items that must have left by `stamp` without the outfeed eye seeing them."""
        self._expire(stamp)
        return self._take_finished()

    def give_up(self, reason: Reason) -> list[Item]:
        """Return all items still on the belt, with `reason`: nothing more will come."""
        self._settle_first()
        for item in self._on_belt:
            item.fault(reason)
        self._finished += self._on_belt
        self._abandoned, self._on_belt = deque(self._on_belt), []
        self._runs_on = reason is Reason.CLOCK_JUMP
        self._covered = self._leaving is not None
        self._entering = self._leaving = None
        return self._take_finished()

    def forget(self, *, backwards: bool = True) -> None:
        """Forget all times, and the edges if the clock may have gone back: they come again."""
        self._entered_last = self._left_last = None
        self._other_clock = True
        self._abandoned += self._given_up
        self._given_up.clear()
        if backwards:
            self._edges.clear()
            self._items.clear()
            self._came_last.clear()
            # What the eyes showed holds, but by another clock: nothing is chatter of it.
            for eye, edge in self._last_edge.items():
                self._last_edge[eye] = replace(edge, stamp=_LONG_AGO)
            self._newest = None
        self._transit = self._odd_transit = self._outfeed_free = None

    def _infeed_blocked(self, stamp: int, previous: EyeEdge | None) -> None:
        last = self._entered_last if self._entered_last is not None else self._begun
        if last is not None and self._flickers(stamp, previous, blocked=True):
            if last.t1 is not None:
                last.t2 = None
            last.fault(Reason.CHATTERING_EYE)
            self._entering = last
            return
        self._merge_flicker()
        entering = self._entering
        if entering is not None:
            entering.fault(Reason.MISSING_EDGE)
        self._give_up_overdue(stamp)
        item = self._new_item()
        item.t1 = stamp
        self._begun = item
        item.others_there = self._leaving is not None or self._covered
        item.left_before = self._departure_before(stamp)
        self._put_on_belt(item)
        self._entering = item

    def _flickers(self, stamp: int, previous: EyeEdge | None, *, blocked: bool) -> bool:
        """Tell whether an edge is chatter; where the one between was lost, twice as long."""
        if previous is None:
            return False
        longest = self._debounce * (2 if previous.blocked == blocked else 1)
        return 0 <= stamp - previous.stamp < longest

    def _infeed_clears(self, stamp: int, previous: EyeEdge | None) -> None:
        item, self._entering = self._entering, None
        if item is not None and item.t4 is None:
            item.t2 = stamp
            return
        if previous is None:
            if not self._is_state(stamp):
                self._cleared_first = stamp
            return
        last = self._entered_last
        if last is not None and last.t2 is not None:
            began = last in self._on_belt and 0 < length(last) < self._longest_flicker(last)
            if began or self._flickers(stamp, previous, blocked=False):
                last.fault(Reason.CHATTERING_EYE)
                last.t2 = stamp
                return
        begun = self._begun if previous.blocked or self._other_clock else None
        is_there = begun is not None and (begun.t4 is None or begun.t4 > stamp)
        if is_there and begun is not None and begun.t2 is None:
            begun.t2 = stamp  # it has its verdict, and is no further item
            return
        self._give_up_overdue(stamp)
        self._enter_unseen(stamp, Reason.MISSING_EDGE)

    def _longest_flicker(self, item: Item) -> int:
        return self._debounce * (_FLICKERS if Reason.CHATTERING_EYE in item.faults else 1)

    def _merge_flicker(self) -> None:
        """Take what is too short for an item for the end of the one before, whose t2 was lost."""
        others = [*self._given_up, *self._on_belt[:-1]]
        if not self._on_belt or not others or self._on_belt[-1].item_id != self._count:
            return
        before, item = others[-1], self._on_belt[-1]
        if before.t1 is None or before.t2 is not None or not length(item):
            return
        if length(item) < self._longest_flicker(item):
            self._on_belt.pop()
            self._items.remove(item)
            self._count -= 1
            before.t2 = item.t2
            before.fault(Reason.CHATTERING_EYE)
            self._entered_last = self._begun = before

    def _enter_unseen(self, stamp: int, reason: Reason) -> None:
        item = self._new_item()
        item.t2 = stamp
        item.fault(reason)
        self._put_on_belt(item)

    def _is_state(self, stamp: int) -> bool:
        """Tell whether an eye that clears first of all may only tell its state at start-up.

        It does so with the first sample or together with the other eye.
        """
        if self.origin is not None:
            after = stamp - self.origin
            if -self._max_transit < after <= self._debounce:
                return True
        return len(self._first_edge) > 1 and (
            abs(self._first_edge[Eye.INFEED] - self._first_edge[Eye.OUTFEED]) <= self._debounce
        )

    def _settle_first(self) -> None:
        """Take the item that the infeed eye saw first of all, unless it has told its state."""
        stamp, self._cleared_first = self._cleared_first, None
        if stamp is not None and not self._is_state(stamp):
            self._enter_unseen(stamp, Reason.START_UP)

    def _outfeed_blocked(self, stamp: int, previous: EyeEdge | None) -> None:
        if self._left_last is None and self._flickers(stamp, previous, blocked=True):
            self._covered = True
            return
        self._covered = False
        only_entering = self._on_belt == [self._entering]
        last = self._covers_outfeed(stamp, previous, blocked=True)
        if last is None and only_entering and previous is not None and previous.blocked:
            last = self._leaving  # its t4 was lost, and what is at one eye is not at the other
            if last is not None and self._entering is not None:
                self._entering.fault(Reason.MISSING_EDGE)
        if last is not None:
            self._leaving, last.t4 = last, None
            return
        # What is yet at the infeed eye cannot be at the outfeed eye, if anything else can.
        gone = (
            self._given_up
            if self._given_up or (self._on_belt and not only_entering)
            else self._abandoned
        )
        if gone and self._is_of_none_on_belt(stamp):
            late = gone.popleft()
            late.t3, late.t4, late.odd = stamp, None, True
            self._leaving = self._left_last = late
            for other in self._on_belt:
                other.fault(Reason.DISTANCE_FAULT)  # it was there as well
            return
        ambiguous = bool(self._given_up or (self._runs_on and self._abandoned))
        self._given_up.clear()  # whatever was before this item has left
        self._abandoned.clear()
        item = self._item_leaving_at(stamp)
        if item is None:
            item = self._new_item()
            item.fault(Reason.MISSING_EDGE)
        item.t3 = stamp
        item.usual_transit = self._transit
        if ambiguous and self._transit_of(item) is None:
            item.fault(Reason.DISTANCE_FAULT)  # which of them it is nothing tells
        if item is self._entering:
            # Too long to be on the belt as a whole, or its edge was lost: t2 tells, if it comes.
            item.fault(Reason.PRODUCT_TOO_LONG)
            item.fault(Reason.MISSING_EDGE)
        before, self._leaving, self._left_last = self._left_last, item, item
        if item.t2 is not None and before is not None and departure(before) > item.t2:
            item.fault(Reason.DISTANCE_FAULT)
        if item.t1 is not None and item.t1 < stamp and not item.faults:
            self._learn(item, stamp - item.t1)
        self._finished.append(item)

    def _outfeed_clears(self, stamp: int, previous: EyeEdge | None) -> None:
        leaving, self._leaving = self._leaving, None
        self._note_departure(stamp)
        if leaving is not None and not self._is_next_departure(stamp):
            leaving.t4 = stamp
            return
        self._outfeed_free = stamp
        if previous is None:
            if self._is_state(stamp):
                return
            for present in self._on_belt:
                present.fault(Reason.START_UP)  # something left that nothing had seen
        if self._covered:
            self._covered = False
            return
        last = self._covers_outfeed(stamp, previous, blocked=False)
        if last is not None:
            last.t4 = stamp
            return
        if self._entering is not None and self._on_belt == [self._entering]:
            self._entering.fault(Reason.DISTANCE_FAULT)  # it cannot have left: another one has
            return
        item = self._item_leaving_at(stamp)
        if item is not None:
            item.fault(Reason.MISSING_EDGE)
            item.t4 = stamp
            self._left_last = item
            self._given_up.append(item)  # it may yet come to the eye, if another one has left
            self._finished.append(item)

    def _covers_outfeed(
        self, stamp: int, previous: EyeEdge | None, *, blocked: bool
    ) -> Item | None:
        """Return the item that left last if it must still be in front of the outfeed eye."""
        last = self._left_last
        if last is None:
            return None
        known = not last.odd and not set(last.faults) - {Reason.DISTANCE_FAULT}
        span = max(length(last) if known else 0, self._debounce)
        if last is self._leaving and self._is_of_none_on_belt(stamp):
            span = max(span, 2 * length(last) or self._transit or 0)  # its t4 was lost
        covers = last.t3 is not None and 0 <= stamp - last.t3 < span
        return last if covers or self._flickers(stamp, previous, blocked=blocked) else None

    def _expire(self, stamp: int) -> None:
        if self._cleared_first is not None and stamp - self._cleared_first > self._max_transit:
            self._settle_first()
        while self._on_belt and stamp - self._on_belt[0].entered > self._max_transit:
            item = self._on_belt.pop(0)
            self._miss(item, item.entered + self._max_transit)

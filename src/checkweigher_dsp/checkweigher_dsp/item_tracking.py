"""Which photo-eye edges belong to which item, and which items cannot be weighed for it.

The four edges of an item are t1 (infeed blocked: it begins to enter), t2 (infeed clears: fully on
the belt), t3 (outfeed blocked: begins to leave) and t4 (outfeed clears: gone).
"""

from dataclasses import dataclass, field

from checkweigher_dsp.records import Eye, EyeEdge, Reason

# An item without its outfeed edge is overdue when it should have left this many transits ago.
_OVERDUE = 1.5


@dataclass(slots=True, eq=False)
class Item:
    """One item on the line, as far as the eyes have seen it; stamps in ns."""

    item_id: int
    t1: int | None = None
    t2: int | None = None
    t3: int | None = None
    t4: int | None = None
    faults: dict[Reason, None] = field(default_factory=dict)  # an ordered set
    left_before: int | None = None  # when the item before it was gone
    usual_transit: int | None = None  # from eye to eye, of the last whole item before it

    @property
    def entered(self) -> int:
        """When it was seen first, ns."""
        known = [stamp for stamp in (self.t1, self.t2, self.t3) if stamp is not None]
        return known[0]

    def fault(self, reason: Reason) -> None:
        """Note why the item cannot be weighed."""
        self.faults.setdefault(reason)


class ItemTracker:
    """Pair the edges of the two eyes to items.

    Items leave in the order in which they entered. Where an edge is missing the time that the last
    whole item took from eye to eye tells which item an edge belongs to, so that one lost edge
    costs one item and not all that follow.

    Parameters
    ----------
    debounce : int
        ns; an eye that clears for less has not cleared, and has chattered.
    max_transit : int
        ns; an item that has not reached the outfeed eye by then never will.
    count : int
        Items that were there before.
    """

    def __init__(self, debounce: int, max_transit: int, count: int = 0) -> None:
        self._debounce = debounce
        self._max_transit = max_transit
        self._count = count
        self._on_belt: list[Item] = []  # seen at the infeed eye, not yet at the outfeed eye
        self._entering: Item | None = None
        self._entered_last: Item | None = None
        self._leaving: Item | None = None
        self._left_last: Item | None = None
        self._given_up: Item | None = None
        self._transit: int | None = None
        self._last_edge: dict[Eye, EyeEdge] = {}
        self._finished: list[Item] = []

    @property
    def count(self) -> int:
        """Number of items so far."""
        return self._count

    def add(self, edge: EyeEdge) -> list[Item]:
        """Take one edge and return the items that it finishes: at t3, or given up."""
        self._expire(edge.stamp)
        previous = self._last_edge.get(edge.eye)
        if previous != edge:
            self._last_edge[edge.eye] = edge
            if edge.eye == Eye.INFEED:
                if edge.blocked:
                    self._infeed_blocked(edge.stamp, previous)
                else:
                    self._infeed_clears(edge.stamp, previous)
            elif edge.blocked:
                self._outfeed_blocked(edge.stamp)
            else:
                self._outfeed_clears(edge.stamp, previous)
        return self._take_finished()

    def expire(self, stamp: int) -> list[Item]:
        """Return the items that must have left by `stamp` without the outfeed eye seeing them."""
        self._expire(stamp)
        return self._take_finished()

    def give_up(self, reason: Reason) -> list[Item]:
        """Return all items still on the belt, with `reason`: nothing more will come."""
        for item in self._on_belt:
            item.fault(reason)
        self._finished += self._on_belt
        self._on_belt = []
        self._entering = self._leaving = None
        return self._take_finished()

    def _take_finished(self) -> list[Item]:
        finished, self._finished = self._finished, []
        return finished

    def _new_item(self) -> Item:
        self._count += 1
        return Item(self._count)

    def _infeed_blocked(self, stamp: int, previous: EyeEdge | None) -> None:
        last = self._entered_last
        if (
            last is not None
            and last.t2 is not None
            and previous is not None
            and not previous.blocked
            and 0 <= stamp - last.t2 < self._debounce
        ):
            if last.t1 is not None:
                last.t2 = None
            last.fault(Reason.CHATTERING_EYE)
            self._entering = last
            return
        if self._entering is not None:
            self._entering.fault(Reason.MISSING_EDGE)
        self._give_up_overdue(stamp)
        item = self._new_item()
        item.t1 = stamp
        item.left_before = self._last_departure(stamp)
        self._put_on_belt(item)
        self._entering = item

    def _infeed_clears(self, stamp: int, previous: EyeEdge | None) -> None:
        item, self._entering = self._entering, None
        if item is not None and item.t4 is None:
            item.t2 = stamp
            return
        if previous is None:
            return  # the state of an eye at start-up, not an edge
        last = self._entered_last
        if last is not None and last.t2 is not None and stamp - last.t2 < self._debounce:
            last.fault(Reason.CHATTERING_EYE)
            return
        self._give_up_overdue(stamp)
        item = self._new_item()
        item.t2 = stamp
        item.fault(Reason.MISSING_EDGE)
        self._put_on_belt(item)

    def _put_on_belt(self, item: Item) -> None:
        """Note that an item has come; with another one on the belt neither can be weighed."""
        for other in self._on_belt:
            other.fault(Reason.DISTANCE_FAULT)
            item.fault(Reason.DISTANCE_FAULT)
        self._on_belt.append(item)
        self._entered_last = item

    def _outfeed_blocked(self, stamp: int) -> None:
        last = self._covers_outfeed(stamp)
        if last is not None:
            self._leaving, last.t4 = last, None
            return
        item = self._item_leaving_at(stamp)
        if item is None:
            if self._given_up is not None:
                # Late, but its verdict is out: it is no further item.
                self._given_up = None
                return
            item = self._new_item()
            item.fault(Reason.MISSING_EDGE)
        item.t3 = stamp
        item.usual_transit = self._transit
        self._given_up = None  # whatever was before this item has left
        if item is self._entering:
            # Too long to be on the belt as a whole, or its edge was lost: t2 tells, if it comes.
            item.fault(Reason.PRODUCT_TOO_LONG)
            item.fault(Reason.MISSING_EDGE)
        previous, self._leaving, self._left_last = self._left_last, item, item
        if item.t2 is not None and previous is not None and _departure(previous) > item.t2:
            item.fault(Reason.DISTANCE_FAULT)
        if item.t1 is not None and item.t1 < stamp and not item.faults:
            self._transit = stamp - item.t1
        self._finished.append(item)

    def _outfeed_clears(self, stamp: int, previous: EyeEdge | None) -> None:
        leaving, self._leaving = self._leaving, None
        # An edge far later than its length allows is that of the next item: its own was lost.
        if leaving is not None and (not _length(leaving) or stamp <= _departure(leaving)):
            leaving.t4 = stamp
            return
        if previous is None:
            return
        last = self._covers_outfeed(stamp)
        if last is not None:
            last.t4 = stamp
            return
        item = self._item_leaving_at(stamp)
        if item is not None:
            item.fault(Reason.MISSING_EDGE)
            item.t4 = stamp
            if item is self._entering:
                self._entering = None
            self._left_last = item
            self._finished.append(item)

    def _covers_outfeed(self, stamp: int) -> Item | None:
        """Return the item that left last if it must still be in front of the outfeed eye."""
        last = self._left_last
        if last is None:
            return None
        covers = last.t3 is not None and 0 <= stamp - last.t3 < max(_length(last), self._debounce)
        flickers = last.t4 is not None and 0 <= stamp - last.t4 < self._debounce
        return last if covers or flickers else None

    def _item_leaving_at(self, stamp: int) -> Item | None:
        """Take from the belt the item that an outfeed edge belongs to, and those before it."""
        if not self._on_belt:
            return None
        position = 0
        if self._transit is not None:
            expected = self._transit
            position = min(
                range(len(self._on_belt)),
                key=lambda i: abs(stamp - self._on_belt[i].entered - expected),
            )
        for passed_over in self._on_belt[:position]:
            self._miss(passed_over)
        item = self._on_belt[position]
        del self._on_belt[: position + 1]
        return item

    def _give_up_overdue(self, stamp: int) -> None:
        """Give up items that, at the pace of the last whole item, left long before `stamp`."""
        if self._transit is None:
            return
        while self._on_belt:
            item = self._on_belt[0]
            if stamp - item.entered < _OVERDUE * self._transit + _length(item):
                return
            self._miss(self._on_belt.pop(0))

    def _expire(self, stamp: int) -> None:
        while self._on_belt and stamp - self._on_belt[0].entered > self._max_transit:
            self._miss(self._on_belt.pop(0))

    def _miss(self, item: Item) -> None:
        item.fault(Reason.MISSING_EDGE)
        if item is self._entering:
            self._entering = None
        self._given_up = item
        self._finished.append(item)

    def _last_departure(self, stamp: int) -> int | None:
        """Return when the last item before `stamp` was gone, as far as the eyes tell."""
        departures = [
            _departure(item) for item in (self._left_last, self._given_up) if item is not None
        ]
        return min(max(departures), stamp) if departures else None


def _departure(item: Item) -> int:
    """Return t4, or where the eye missed it the time by which the item's length had passed."""
    if item.t4 is not None:
        return item.t4
    last_seen = item.t3 if item.t3 is not None else item.entered
    return last_seen + 2 * _length(item)


def _length(item: Item) -> int:
    """Return how long an item takes to pass an eye, ns; 0 if that is not known."""
    return item.t2 - item.t1 if item.t1 is not None and item.t2 is not None else 0

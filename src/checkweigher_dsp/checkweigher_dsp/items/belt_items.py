"""What is known of the items on the belt and of those that left it: who may be at which eye."""

from collections import deque

from checkweigher_dsp.items.item import Item, accounts_for, departure, length
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import EyeEdge

# An item without its outfeed edge is overdue when it should have left this many transits ago.
_OVERDUE = 1.5
# An outfeed edge this much ahead of its time, as a share of the transit, is of another item.
_TOO_EARLY = 0.1
_KNOWN_ITEMS = 16


class BeltItems:
    """Keep the items in the order in which they entered, and how long they take from eye to eye.

    The parameters are those of `ItemTracker`, which builds on it.
    """

    def __init__(
        self, debounce: int, max_transit: int, count: int = 0, belt_lengths: float = 0.0
    ) -> None:
        self._debounce = debounce
        self._max_transit = max_transit
        self._belt_lengths = belt_lengths
        self._count = count
        self._on_belt: list[Item] = []  # seen at the infeed eye, not yet at the outfeed eye
        self._entering: Item | None = None
        self._entered_last: Item | None = None
        self._begun: Item | None = None  # of the last t1, whatever has become of it
        self._leaving: Item | None = None
        self._covered = False  # the outfeed eye, by an item from before the clock began anew
        self._left_last: Item | None = None
        # Their verdict is out, but the outfeed eye may see them yet.
        self._given_up: deque[Item] = deque(maxlen=_KNOWN_ITEMS)
        self._abandoned: deque[Item] = deque()  # likewise, but only while nothing else is there
        self._transit: int | None = None
        self._odd_transit: int | None = None
        self._items: deque[Item] = deque(maxlen=_KNOWN_ITEMS)
        self._outfeed_free: int | None = None  # when something unknown had left
        self._finished: list[Item] = []

    @property
    def count(self) -> int:
        """Number of items so far."""
        return self._count

    def _is_known(self, edge: EyeEdge) -> bool:
        return any(accounts_for(item, edge.stamp, self._debounce) for item in self._items)

    def _doubt_all(self) -> None:
        for item in self._on_belt:
            item.fault(Reason.LATE_EDGE)

    def _complete_infeed(self, stamp: int) -> bool:
        """Note the t2 of an item that was at the outfeed eye before this edge came."""
        for item in self._items:
            begin = item.t1 if item.t1 is not None else stamp - 1
            if item.t2 is None and item.t3 is not None and begin < stamp < item.t3:
                item.t2 = stamp
                return True
        return False

    def _complete_outfeed(self, edge: EyeEdge) -> None:
        """Note an edge of an item that has left, as far as it is one."""
        if edge.blocked:
            for item in self._items:
                if item.t3 is None and item.t4 is not None and item.entered < edge.stamp < item.t4:
                    item.t3 = edge.stamp
                    return
            return
        leaving = self._leaving
        if leaving is not None and leaving.t3 is not None and leaving.t3 < edge.stamp:
            leaving.t4, self._leaving = edge.stamp, None

    def _take_finished(self) -> list[Item]:
        finished, self._finished = self._finished, []
        return finished

    def _new_item(self) -> Item:
        self._count += 1
        item = Item(self._count)
        self._items.append(item)
        return item

    def _put_on_belt(self, item: Item) -> None:
        """Note that an item has come; with another one on the belt neither can be weighed."""
        for other in self._on_belt:
            other.fault(Reason.DISTANCE_FAULT)
            item.fault(Reason.DISTANCE_FAULT)
        self._on_belt.append(item)
        self._entered_last = item

    def _departure_before(self, stamp: int) -> int | None:
        """Return when what was before an item that enters at `stamp` is gone, as far as known."""
        if self._covered:
            return None
        return (
            departure(self._leaving) if self._leaving is not None else self._last_departure(stamp)
        )

    def _note_departure(self, stamp: int) -> None:
        """Note for what entered while something left that it is gone."""
        for item in self._on_belt:
            if item.others_there:
                item.left_before = stamp

    def _learn(self, item: Item, transit: int) -> None:
        """Learn how long an item takes; from one that is far off only if the next one agrees."""
        known = [usual for usual in (self._transit, self._odd_transit) if usual is not None]
        item.odd = self._transit is not None and not any(
            transit <= _OVERDUE * usual and usual <= _OVERDUE * transit for usual in known
        )
        if item.odd:
            self._odd_transit = transit
        else:
            self._transit, self._odd_transit = transit, None

    def _is_next_departure(self, stamp: int) -> bool:
        """Tell whether the next item must have left just now: its t3 was lost, and the last t4."""
        if not self._on_belt or self._on_belt[0] is self._entering:
            return False
        item = self._on_belt[0]
        transit = self._transit_of(item)
        if transit is None or not length(item):
            return False
        return abs(stamp - item.entered - length(item) - transit) < _TOO_EARLY * transit

    def _item_leaving_at(self, stamp: int) -> Item | None:
        """Take from the belt the item that an outfeed edge belongs to, and those before it."""
        if not self._on_belt:
            return None
        position, least = 0, None
        for i, candidate in enumerate(self._on_belt):
            transit = self._transit_of(candidate)
            if transit is not None and (not self._is_entering(candidate, stamp) or not i):
                deviation = abs(stamp - candidate.entered - transit)
                if least is None or deviation < least:
                    position, least = i, deviation
        for passed_over in self._on_belt[:position]:
            self._miss(passed_over, stamp)
        item = self._on_belt[position]
        del self._on_belt[: position + 1]
        return item

    def _give_up_overdue(self, stamp: int) -> None:
        """Give up items that, at the pace of the last whole item, left long before `stamp`."""
        while self._on_belt:
            item = self._on_belt[0]
            transit = self._transit_of(item)
            if transit is None or stamp - item.entered < _OVERDUE * transit + length(item):
                return
            self._miss(self._on_belt.pop(0), stamp)

    def _transit_of(self, item: Item) -> int | None:
        """Return how long an item takes from eye to eye, as far as that is known."""
        if self._transit is None and self._belt_lengths and length(item) > 0:
            return min(round(length(item) * self._belt_lengths), self._max_transit)
        return self._transit

    def _is_entering(self, item: Item, stamp: int) -> bool:
        return item is self._entering or (item.t2 is not None and item.t2 > stamp)

    def _is_of_none_on_belt(self, stamp: int) -> bool:
        """Tell whether the outfeed eye sees something that was given up, and not what is there."""
        for item in self._on_belt:
            transit = self._transit_of(item)
            if self._is_entering(item, stamp):
                continue  # what is at one eye is not at the other
            if transit is None or item.t1 is None:
                return False
            if stamp - item.t1 > (1 - _TOO_EARLY) * transit:
                return False
        return True

    def _miss(self, item: Item, stamp: int) -> None:
        item.fault(Reason.MISSING_EDGE)
        item.given_up = stamp
        if item is self._entering:
            self._entering = None
        self._given_up.append(item)
        self._finished.append(item)

    def _last_departure(self, stamp: int) -> int | None:
        """Return when the last item before `stamp` was gone, as far as the eyes tell."""
        gone = [*self._given_up, *([self._left_last] if self._left_last is not None else [])]
        departures = [departure(item) for item in gone]
        if self._outfeed_free is not None:
            departures.append(self._outfeed_free)
        return min(max(departures), stamp) if departures else None

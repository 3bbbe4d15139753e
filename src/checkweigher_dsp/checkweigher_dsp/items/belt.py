# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The items on the belt and those that left it, and which of them an edge can be of."""

from collections import deque
from collections.abc import Callable

from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.eyes import Eyes
from checkweigher_dsp.items.item import YET_TO_LEAVE, State, TrackedItem

# An item without its outfeed edge is overdue when it should have left this many transits ago.
_OVERDUE = 1.5
# An outfeed edge this much ahead of its time, as a share of the transit, is of another item.
_TOO_EARLY = 0.1
_KNOWN_ITEMS = 16
_MOST_ITEMS = 100  # on the belt: more means that an eye chatters


class UsualTransit:
    """The time that items take from eye to eye; the arguments are those of `ItemTracker`."""

    def __init__(self, max_transit: int, belt_lengths: float) -> None:
        self.max_transit = max_transit
        self.value: int | None = None  # ns, of the last whole item
        self._belt_lengths = belt_lengths
        self._outlier: int | None = None

    def of(self, item: TrackedItem) -> int | None:
        """Return how long an item takes, ns; before a whole one only its own length can tell."""
        if self.value is None and self._belt_lengths and item.length > 0:
            return min(round(item.length * self._belt_lengths), self.max_transit)
        return self.value

    def learn(self, item: TrackedItem, transit: int) -> None:
        """Learn from a whole item; from one that is far off only if the next one agrees."""
        known = [usual for usual in (self.value, self._outlier) if usual is not None]
        item.outlier = self.value is not None and not any(
            transit <= _OVERDUE * usual and usual <= _OVERDUE * transit for usual in known
        )
        if item.outlier:
            self._outlier = transit
        else:
            self.value, self._outlier = transit, None

    def forget(self) -> None:
        """Forget the speed of the belt."""
        self.value = self._outlier = None


class Belt:
    """The state of item tracking; `checkweigher_dsp.items.transitions` says how edges change it.

    `unloaded` tells whether the scale shows that nothing is left, at a time, ns, of the items that
    entered since another one.
    """

    def __init__(
        self, eyes: Eyes, transit: UsualTransit, count: int,
        unloaded: Callable[[int, int], bool] = lambda since, stamp: False,
    ) -> None:  # fmt: skip
        self.eyes = eyes
        self.transit = transit
        self.unloaded = unloaded
        self.count = count
        # Items by their state: ENTERING or ON_BELT, in the order of their entry, and the two that
        # the outfeed eye may see yet.
        self.items: list[TrackedItem] = []
        self.given_up: deque[TrackedItem] = deque(maxlen=_KNOWN_ITEMS)
        self.abandoned: deque[TrackedItem] = deque()
        # What blocks an eye; an item that is longer than the belt blocks both.
        self.at_infeed: TrackedItem | None = None
        self.at_outfeed: TrackedItem | None = None
        self.covered = False  # the outfeed eye, by an item from before the clock changed
        self.entered_last: TrackedItem | None = None
        self.left_last: TrackedItem | None = None
        # The item of the last t1, also where its clock has gone.
        self.begun: TrackedItem | None = None
        self.freed: int | None = None  # ns, when something unknown had left
        self.cleared_first: int | None = None  # ns, the infeed eye, before it was ever blocked
        self.clock_is_new = False  # no edge of the infeed eye has come by this clock
        self.runs_on = False  # the belt, with what was abandoned: the clock alone has jumped
        self._recent: deque[TrackedItem] = deque(maxlen=_KNOWN_ITEMS)
        self._unsettled: deque[TrackedItem] = deque()
        self._finished: list[TrackedItem] = []

    @property
    def only_entering(self) -> bool:
        """Whether one item is on the belt, which blocks the infeed eye."""
        return len(self.items) == 1 and self.items[0] is self.at_infeed

    def new_item(self) -> TrackedItem:
        """Return a further item, which has the next number."""
        self.count += 1
        item = TrackedItem(self.count)
        self._recent.append(item)
        self._unsettled.append(item)
        return item

    def remove_newest(self) -> TrackedItem:
        """Remove the newest item, which is not settled: it was none."""
        item = self.items.pop()
        self._recent.remove(item)
        self._unsettled.remove(item)
        self.count -= 1
        return item

    def next_to_settle(self) -> TrackedItem | None:
        """Return the first item whose number may change, None if there is none."""
        return self._unsettled[0] if self._unsettled else None

    def settle_next(self) -> TrackedItem:
        """Return the first item whose number might have changed: it stays."""
        item = self._unsettled.popleft()
        item.settled = True
        return item

    def put(self, item: TrackedItem) -> None:
        """Put an item on the belt; with another one there neither can be weighed."""
        if len(self.items) >= _MOST_ITEMS:
            self.miss(self.items.pop(0), item.entered)
        self.items.append(item)
        if len(self.items) > 1:
            self.fault_all(Reason.DISTANCE_FAULT)
        self.entered_last = item

    def move(self, item: TrackedItem, state: State) -> None:
        """Change the state of an item; one that has left the belt does not come back onto it."""
        if state is State.LEAVING:
            self.at_outfeed = self.left_last = item
            self.covered = False
        elif state is State.ENTERING:
            self.at_infeed = item
        elif state is State.GIVEN_UP:
            self.given_up.append(item)
        if item.state in YET_TO_LEAVE or state not in YET_TO_LEAVE:
            item.state = state

    def finish(self, item: TrackedItem) -> None:
        """Report an item: what the eyes have shown of it by now is what it is judged by."""
        self._finished.append(item)

    def take_finished(self) -> list[TrackedItem]:
        """Return the items reported since the last call."""
        finished, self._finished = self._finished, []
        return finished

    def miss(self, item: TrackedItem, stamp: int) -> None:
        """Give up an item that was taken off `items`: its t3 does not come."""
        item.fault(Reason.MISSING_EDGE)
        item.given_up = stamp
        if item is self.at_infeed:
            self.at_infeed = None
        self.move(item, State.GIVEN_UP)
        self.finish(item)

    def give_up_overdue(self, stamp: int) -> None:
        """Give up items that, at the pace of the last whole item, left long before `stamp`."""
        while self.items:
            item = self.items[0]
            transit = self.transit.of(item)
            if transit is None or stamp - item.entered < _OVERDUE * transit + item.length:
                return
            self.miss(self.items.pop(0), stamp)

    def give_up_unloaded(self, stamp: int) -> None:
        """Give up items that the scale does not show any more, and that no eye will see.

        Where no transit is known, or a wrong one, the t3 of each item would else be taken for that
        of the one before it, for as long as products come.
        """
        if not self.items or not self.unloaded(self.items[0].entered, stamp):
            return
        gone, self.items = self.items, []
        for item in gone:
            item.fault(Reason.MISSING_EDGE)
            item.state = State.GONE
            self.finish(item)
        self.at_infeed, self.freed = None, stamp

    def expire(self, stamp: int) -> None:
        """Give up items that must have left by `stamp`, even on the slowest belt."""
        while self.items and stamp - self.items[0].entered > self.transit.max_transit:
            item = self.items.pop(0)
            self.miss(item, item.entered + self.transit.max_transit)

    def abandon(self, reason: Reason) -> None:
        """Give up all items, with `reason`: nothing more will come of this stream."""
        for item in (*self.abandoned, *([self.at_outfeed] if self.at_outfeed is not None else [])):
            item.state = State.GONE
        for item in self.items:
            item.fault(reason)
            item.state = State.ABANDONED
            self.finish(item)
        self.abandoned, self.items = deque(self.items), []
        self.runs_on = reason is Reason.CLOCK_JUMP
        self.covered = self.at_outfeed is not None
        self.at_infeed = self.at_outfeed = None

    def forget_clock(self, *, backwards: bool) -> None:
        """Forget all times, and if the clock may have gone back also the edges and their items."""
        self.entered_last = self.left_last = self.freed = None
        self.clock_is_new = True
        for item in self.given_up:
            item.state = State.ABANDONED
        self.abandoned += self.given_up
        self.given_up.clear()
        self.transit.forget()
        if backwards:
            self._recent.clear()
            self.eyes.forget_clock()

    def fault_all(self, reason: Reason) -> None:
        """Fault all items on the belt."""
        for item in self.items:
            item.fault(reason)

    def clear_outfeed(self, stamp: int) -> None:
        """Take the item away from the outfeed eye; for those that entered meanwhile it is gone."""
        self.at_outfeed = None
        for item in self.items:
            if item.others_there:
                item.left_before = stamp

    def drop_given_up(self) -> bool:
        """Take all that was before an item as gone; tell whether it may have been one of these."""
        ambiguous = bool(self.given_up or (self.runs_on and self.abandoned))
        for item in (*self.given_up, *self.abandoned):
            item.state = State.GONE
        self.given_up.clear()
        self.abandoned.clear()
        return ambiguous

    def departure_before(self, stamp: int) -> int | None:
        """Return when what was there before an item that enters at `stamp` is gone, if known."""
        if self.covered:
            return None
        if self.at_outfeed is not None:
            return self.at_outfeed.departure
        return self.last_departure(stamp)

    def last_departure(self, stamp: int) -> int | None:
        """Return when the last item before `stamp` was gone, by the eyes."""
        left = [item for item in (*self.given_up, self.left_last) if item is not None]
        departures = [item.departure for item in left]
        if self.freed is not None:
            departures.append(self.freed)
        return min(max(departures), stamp) if departures else None

    def is_next_departure(self, stamp: int) -> bool:
        """Tell whether the next item must have left just now: its t3 was lost, and the last t4."""
        if not self.items or self.items[0] is self.at_infeed:
            return False
        item = self.items[0]
        transit = self.transit.of(item)
        if transit is None or not item.length:
            return False
        return abs(stamp - item.entered - item.length - transit) < _TOO_EARLY * transit

    def is_none_due(self, stamp: int) -> bool:
        """Tell whether no item on the belt can be at the outfeed eye yet."""
        for item in self.items:
            if self._is_entering(item, stamp):
                continue  # what is at one eye is not at the other
            transit = self.transit.of(item)
            if transit is None or item.t1 is None or stamp - item.t1 > (1 - _TOO_EARLY) * transit:
                return False
        return True

    def take_leaving(self, stamp: int) -> TrackedItem:
        """Take from the belt the item that an outfeed edge is of, and give up those before it.

        It is the one whose transit would be nearest to the usual one.
        """
        position, least = 0, None
        for i, candidate in enumerate(self.items):
            transit = self.transit.of(candidate)
            if transit is not None and (not self._is_entering(candidate, stamp) or not i):
                deviation = abs(stamp - candidate.entered - transit)
                if least is None or deviation < least:
                    position, least = i, deviation
        for passed_over in self.items[:position]:
            self.miss(passed_over, stamp)
        item = self.items[position]
        del self.items[: position + 1]
        return item

    def _is_entering(self, item: TrackedItem, stamp: int) -> bool:
        return item is self.at_infeed or (item.t2 is not None and item.t2 > stamp)

    def entered_at(self, stamp: int) -> TrackedItem | None:
        """Return the item by which the infeed eye can have been blocked at `stamp`."""
        debounce = self.eyes.debounce
        return next((item for item in self._recent if item.accounts_for(stamp, debounce)), None)

    def without_t2(self, stamp: int) -> TrackedItem | None:
        """Return an item at or past the outfeed eye that can have cleared the infeed at `stamp`."""
        for item in self._recent:
            begin = item.t1 if item.t1 is not None else stamp - 1
            if item.t2 is None and item.t3 is not None and begin < stamp < item.t3:
                return item
        return None

    def complete_t3(self, stamp: int) -> None:
        """Note the t3 of an item that has left, if one lacks it."""
        for item in self._recent:
            if item.t3 is None and item.t4 is not None and item.entered < stamp < item.t4:
                item.t3 = stamp
                return

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""State of item tracking: the items on the belt and the items that have left it."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.eyes import Eyes
from checkweigher_dsp.items.item import YET_TO_LEAVE, State, TrackedItem

# Largest ratio of a transit to the usual transit, or of the usual transit to a transit, at which
# the transit is not an outlier. An item is overdue if it has been on the belt for 1.5 times its
# expected transit plus the time for which it blocks an eye.
_OVERDUE = 1.5
# Tolerance of the time of an outfeed edge, as a fraction of the expected transit of the item. An
# edge that precedes its expected time by at least this tolerance is too early for the item.
_TOO_EARLY = 0.1
_KNOWN_ITEMS = 16  # maximum number of stored recent items, and of stored given-up items
_MOST_ITEMS = 100  # maximum number of items on the belt, which is reached only if an eye chatters


class UsualTransit:
    """Usual transit of the items, which is the time from t1 to t3 in ns.

    See `ItemTracker` for the parameters.
    """

    def __init__(self, max_transit: int, belt_lengths: float) -> None:
        self.max_transit = max_transit
        self._belt_lengths = belt_lengths
        self.forget()

    def forget(self) -> None:
        """Discard the usual transit and the latest outlier, which may no longer be valid."""
        self.value: int | None = None  # last accepted transit in ns, or None if there is none
        self._outlier: int | None = None

    def of(self, item: TrackedItem) -> int | None:
        """Return the expected transit of an item in ns, or None if it is unknown.

        The expected transit is the usual transit. While no usual transit is known, the expected
        transit is estimated from the time for which `item` blocked the infeed eye. The estimate
        requires t1, t2 and the length of the products, and is limited to `max_transit`.
        """
        if self.value is None and self._belt_lengths and item.length > 0:
            return min(round(item.length * self._belt_lengths), self.max_transit)
        return self.value

    def learn(self, item: TrackedItem, transit: int) -> None:
        """Update the usual transit by the transit of an item in ns.

        A transit that differs from the usual transit by a factor above 1.5 is an outlier, unless
        the previous transit was a similar outlier. An outlier does not change the usual transit.
        Any other transit becomes the usual transit, as does the first transit.
        """
        known = [usual for usual in (self.value, self._outlier) if usual is not None]
        item.outlier = self.value is not None and not any(
            transit <= _OVERDUE * usual and usual <= _OVERDUE * transit for usual in known
        )
        if item.outlier:
            self._outlier = transit
        else:
            self.value, self._outlier = transit, None

    def has_passed(self, item: TrackedItem, stamp: int) -> bool:
        """Return whether an item must have left the belt by the time `stamp` in ns.

        The result is False if the expected transit of the item is unknown.
        """
        transit = self.of(item)
        return transit is not None and stamp - item.entered >= _OVERDUE * transit + item.length

    def ends(self, item: TrackedItem, stamp: int) -> bool:
        """Return whether an item is expected to clear the outfeed eye at about `stamp` in ns.

        The result is False if the expected transit of the item, or t1 or t2, is unknown.
        """
        transit = self.of(item)
        if transit is None or not item.length:
            return False
        return abs(stamp - item.entered - item.length - transit) < _TOO_EARLY * transit

    def is_early(self, item: TrackedItem, stamp: int) -> bool:
        """Return whether `stamp`, in ns, is too early for an item to reach the outfeed eye.

        The result is False if the expected transit of the item or t1 is unknown.
        """
        transit = self.of(item)
        return (
            transit is not None
            and item.t1 is not None
            and stamp - item.t1 <= (1 - _TOO_EARLY) * transit
        )


@dataclass(eq=False)
class Belt:
    """State of item tracking, which `checkweigher_dsp.items.transitions` updates after each edge.

    ``unloaded(since, stamp)`` returns whether the scale shows that all items that entered at or
    after the time `since` had left by the time `stamp`. Both times are in ns.
    """

    eyes: Eyes
    transit: UsualTransit
    count: int  # number of the newest item
    unloaded: Callable[[int, int], bool] = lambda since, stamp: False

    def __post_init__(self) -> None:
        self.items: list[TrackedItem] = []  # items on the belt in the order of their entry
        self.given_up: deque[TrackedItem] = deque(maxlen=_KNOWN_ITEMS)
        self.abandoned: deque[TrackedItem] = deque()
        # Items that block an eye. An item that is longer than the belt blocks both eyes.
        self.at_infeed: TrackedItem | None = None
        self.at_outfeed: TrackedItem | None = None
        self.covered = False  # whether an unknown or abandoned item blocks the outfeed eye
        self.entered_last: TrackedItem | None = None
        self.left_last: TrackedItem | None = None
        # Latest item with t1. Unlike `entered_last`, `begun` is kept when the clock changes.
        self.begun: TrackedItem | None = None
        # Latest time in ns of one of these events, or None: an unknown item left, the last item
        # left again after chatter of the eye, or the scale showed an empty belt.
        self.freed: int | None = None
        # Time in ns of the first edge of the infeed eye, if this edge cleared the eye and waits for
        # `settle_first`, otherwise None. A first edge that clears the eye may only show the initial
        # state of the eye.
        self.cleared_first: int | None = None
        # Whether the clock has changed and the infeed eye has had no edge since then.
        self.clock_is_new = False
        # Whether abandoned items may still be on the belt, because a jump of the clock does not
        # stop the belt.
        self.runs_on = False
        self.recent: deque[TrackedItem] = deque(maxlen=_KNOWN_ITEMS)
        self.unsettled: deque[TrackedItem] = deque()  # items whose numbers may still change
        self.finished: list[TrackedItem] = []  # items that `take_finished` returns next

    @property
    def only_entering(self) -> bool:
        """Whether only one item is on the belt, and this item blocks the infeed eye."""
        return len(self.items) == 1 and self.items[0] is self.at_infeed

    def new_item(self) -> TrackedItem:
        """Return a new item with the next number."""
        self.count += 1
        item = TrackedItem(self.count)
        self.recent.append(item)
        self.unsettled.append(item)
        return item

    def remove_newest(self) -> TrackedItem:
        """Remove and return the newest item, because it was only a flicker of the eye."""
        item = self.items.pop()
        self.recent.remove(item)
        self.unsettled.remove(item)
        self.count -= 1
        return item

    def put(self, item: TrackedItem) -> None:
        """Add an item to the belt.

        If other items are on the belt, the fault DISTANCE_FAULT is added to all items on the belt,
        including the new one. If 100 items are already on the belt, the oldest one is given up
        before the new item is added.
        """
        if len(self.items) >= _MOST_ITEMS:
            self.miss(self.items.pop(0), item.entered)
        self.items.append(item)
        if len(self.items) > 1:
            self.fault_all(Reason.DISTANCE_FAULT)
        self.entered_last = item

    def move(self, item: TrackedItem, state: State) -> None:
        """Change the state of an item, and register the item at the eye that it blocks.

        A given-up item is added to `given_up`. The state of an item that has left the belt does not
        become ENTERING or ON_BELT again.
        """
        if state is State.LEAVING:
            self.at_outfeed = self.left_last = item
            self.covered = False
        elif state is State.ENTERING:
            self.at_infeed = item
        elif state is State.GIVEN_UP:
            self.given_up.append(item)
        if item.state in YET_TO_LEAVE or state not in YET_TO_LEAVE:
            item.state = state

    def take_finished(self) -> list[TrackedItem]:
        """Return the items that have been finished since the last call."""
        finished, self.finished = self.finished, []
        return finished

    def miss(self, item: TrackedItem, stamp: int) -> None:
        """Give up an item as a fault, because its outfeed edge is missing.

        `stamp` is the time in ns at which the item is given up. The caller must have removed the
        item from `items`.
        """
        item.fault(Reason.MISSING_EDGE)
        item.given_up = stamp
        if item is self.at_infeed:
            self.at_infeed = None
        self.move(item, State.GIVEN_UP)
        self.finished.append(item)

    def give_up_overdue(self, stamp: int) -> None:
        """Give up the items that are overdue at `stamp`, in ns, according to `has_passed`."""
        while self.items and self.transit.has_passed(self.items[0], stamp):
            self.miss(self.items.pop(0), stamp)

    def give_up_unloaded(self, stamp: int) -> None:
        """Give up all items if the scale shows at `stamp`, in ns, that the belt is empty.

        If items that have left were not given up, each later outfeed edge would be assigned to the
        item ahead of the correct one.
        """
        if not self.items or not self.unloaded(self.items[0].entered, stamp):
            return
        self.fault_all(Reason.MISSING_EDGE)
        _set_state(self.items, State.GONE)
        self.finished += self.items
        self.items, self.at_infeed, self.freed = [], None, stamp

    def expire(self, stamp: int) -> None:
        """Give up the items that entered more than `max_transit` before `stamp`, in ns."""
        while self.items and stamp - self.items[0].entered > self.transit.max_transit:
            item = self.items.pop(0)
            self.miss(item, item.entered + self.transit.max_transit)

    def abandon(self, reason: Reason) -> None:
        """Give up all items as faults with a reason, because the stream has ended.

        A change of the source or of the clock also ends a stream.
        """
        _set_state(filter(None, (*self.abandoned, self.at_outfeed)), State.GONE)
        self.fault_all(reason)
        _set_state(self.items, State.ABANDONED)
        self.finished += self.items
        self.abandoned, self.items = deque(self.items), []
        self.runs_on = reason is Reason.CLOCK_JUMP
        self.covered = self.at_outfeed is not None
        self.at_infeed = self.at_outfeed = None

    def forget_clock(self, *, backwards: bool) -> None:
        """Discard the departure times and the usual transit, because the clock has changed.

        The last item that entered and the last item that left are discarded too. The items that
        were given up get the state ABANDONED, so that an edge is assigned to one of them only if no
        other item fits. If the clock has gone `backwards`, the recent items and the times of the
        edges of the eyes are discarded as well.
        """
        self.entered_last = self.left_last = self.freed = None
        self.clock_is_new = True
        _set_state(self.given_up, State.ABANDONED)
        self.abandoned += self.given_up
        self.given_up.clear()
        self.transit.forget()
        if backwards:
            self.recent.clear()
            self.eyes.forget_clock()

    def fault_all(self, reason: Reason) -> None:
        """Add a fault to all items on the belt."""
        for item in self.items:
            item.fault(reason)

    def clear(self, edge: EyeEdge) -> None:
        """Mark the eye of a clearing edge as clear.

        An edge of the outfeed eye also sets `left_before` of each item on the belt for which
        `others_there` is true, because the item at the outfeed eye has now left.
        """
        if edge.eye == Eye.INFEED:
            self.at_infeed = None
            return
        self.at_outfeed = None
        for item in self.items:
            if item.others_there:
                item.left_before = edge.stamp

    def drop_given_up(self) -> bool:
        """Remove given-up and abandoned items, whose state becomes GONE.

        Returns whether one of the removed items may be the item that is leaving now.
        """
        ambiguous = bool(self.given_up or (self.runs_on and self.abandoned))
        _set_state((*self.given_up, *self.abandoned), State.GONE)
        self.given_up.clear()
        self.abandoned.clear()
        return ambiguous


def _set_state(items: Iterable[TrackedItem], state: State) -> None:
    for item in items:
        item.state = state

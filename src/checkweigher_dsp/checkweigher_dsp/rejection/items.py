# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items that wait for their verdict, and estimates that wait for their item."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from checkweigher_core.records import NUMBERS_AT_ONCE, Item, MassEstimate, Verdict

# Maximum number of stored numbers of items with a verdict, above the number of messages that the
# topic `items` keeps.
MAX_JUDGED = 1_024
_MAX_OWN = 1_000  # maximum number of stored numbers of items without an announcement


@dataclass(slots=True, eq=False)
class PendingItem:
    """Item without a verdict. Times are in ns on the clock of arrivals unless stated otherwise."""

    item: Item
    reject_at: int | None = None  # reject time on the clock of the stamps
    due: int | None = None  # deadline of the verdict
    late_from: int | None = None  # time after which the verdict is late
    ready: int | None = None  # time at which the answer times of all devices are over
    by_mass: Verdict | None = None  # verdict on the mass, which waits for the inspection devices


class PendingItems:
    """Announced items without a verdict, and the latest numbers of items with a verdict.

    The segmenter announces an item by an `Item` record. `judged` are the numbers of items that
    received their verdict from an earlier process.
    """

    def __init__(self, judged: Iterable[int] = ()) -> None:
        # Items without a verdict by number, in the order of their announcement.
        self.pending: dict[int, PendingItem] = {}
        # Numbers of items with a verdict, in the order of the verdicts. The value of a number is
        # True if this process gave the verdict.
        self._judged = dict.fromkeys(sorted(judged)[-MAX_JUDGED:], False)
        # Numbers of items that received their verdict under another number. The caller must empty
        # `passed_over`.
        self.passed_over: list[int] = []
        self._forgotten = 0  # largest item number with a verdict that is no longer stored.
        # Numbers of items that no segmenter announced.
        self._own: deque[int] = deque(maxlen=_MAX_OWN)
        self.largest = max(self._judged, default=0)  # largest number so far

    def announce(self, item: Item) -> PendingItem | None:
        """Add an announcement and return its item, or None if the item has a verdict."""
        pending = self.pending.get(item.item_id)
        if pending is not None:
            pending.item = item
            return pending
        if self.has_verdict(item.item_id):
            return None
        self.largest = max(self.largest, item.item_id)
        pending = self.pending[item.item_id] = PendingItem(item)
        return pending

    def has_verdict(self, number: int) -> bool:
        """Return whether an item has a verdict.

        An item whose number is at most the largest number that is no longer stored counts as an
        item with a verdict.
        """
        return number in self._judged or number <= self._forgotten

    def judged_here(self, number: int) -> bool:
        """Return whether this process gave the verdict on an item and still stores the number."""
        return self._judged.get(number, False)

    def judge(self, number: int) -> None:
        """Store the number of an item that has a verdict, and remove the item."""
        self.pending.pop(number, None)
        self._judged[number] = True
        self.largest = max(self.largest, number)
        if len(self._judged) > MAX_JUDGED:
            forgotten = next(iter(self._judged))
            del self._judged[forgotten]
            self._forgotten = max(self._forgotten, forgotten)

    def pass_over(self, number: int) -> None:
        """Remove an item that received its verdict under another number, and store its number."""
        self.judge(number)
        self.passed_over.append(number)

    def unannounced(self, stamp: int, after: int) -> PendingItem | None:
        """Return a new item that no segmenter has announced, or None if no number is free.

        `stamp` is the time in ns of the outfeed edge of the item, and `after` is the largest item
        number when this edge arrived. The new item gets the next free number above `after`. Only
        numbers below the next multiple of `NUMBERS_AT_ONCE` are free, because a restarted segmenter
        continues there. No number is free if `after` is 0, because no item number is known then.
        """
        number = after + 1
        while self.has_verdict(number) or number in self.pending:
            number += 1
        if after == 0 or number // NUMBERS_AT_ONCE > after // NUMBERS_AT_ONCE:
            return None
        self._own.append(number)
        return PendingItem(Item(stamp, 0, number))

    def is_own(self, number: int) -> bool:
        """Return whether a number was given to an item that no segmenter announced."""
        return number in self._own

    def on_belt(self, before: int | None = None) -> list[PendingItem]:
        """Return the items that are not complete, in the order of their numbers.

        If `before` is not None, only items with a smaller number are returned.
        """
        return [
            each
            for number, each in sorted(self.pending.items())
            if not each.item.complete and (before is None or number < before)
        ]

    def entered_before(self, stamp: int) -> PendingItem | None:
        """Return the oldest item on the belt that entered before a stamp in ns, or None."""
        return next((each for each in self.on_belt() if (each.item.stamp or 0) < stamp), None)


class EarlyEstimates:
    """Estimates that wait until their items are complete. Times are in ns."""

    def __init__(self) -> None:
        self.unknown = 0  # number of estimates whose items did not become complete in time
        self._waiting: dict[int, tuple[MassEstimate, int | None]] = {}

    def add(self, estimate: MassEstimate, until: int | None) -> None:
        """Add an estimate.

        `until` is the time on the clock of arrivals at which the estimate expires. If `until` is
        None, the estimate does not expire.
        """
        self._waiting[estimate.item_id] = estimate, until

    def take(self, number: int) -> MassEstimate | None:
        """Remove and return the estimate of an item, or return None if none is waiting."""
        estimate, _ = self._waiting.pop(number, (None, None))
        return estimate

    @property
    def due(self) -> int | None:
        """Time in ns at which the next estimate expires, or None if no estimate expires."""
        return min(
            (until for _, until in self._waiting.values() if until is not None), default=None
        )

    def advance(self, now: int) -> None:
        """Remove the estimates that have expired by `now`, and count them in `unknown`."""
        kept = {n: each for n, each in self._waiting.items() if each[1] is None or each[1] > now}
        self.unknown += len(self._waiting) - len(kept)
        self._waiting = kept

    def clear(self) -> None:
        """Remove all estimates."""
        self._waiting.clear()

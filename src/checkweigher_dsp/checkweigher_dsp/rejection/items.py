# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The announced items that wait for their verdict, and the numbers of those that have it."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from checkweigher_core.records import NUMBERS_AT_ONCE, Item, Verdict

MAX_JUDGED = 1_024  # numbers; more than the port `items` keeps for a node that is started again
_MAX_PENDING = 10_000


@dataclass(slots=True, eq=False)
class PendingItem:
    """An announced item without a verdict; all times in ns."""

    item: Item
    reject_at: int | None = None  # when the rejector has to be told
    # On the clock of arrivals: when a verdict can wait no longer, and when it is too late.
    due: int | None = None
    late_from: int | None = None
    # By its mass, while inspection devices have yet to answer; until when.
    held: Verdict | None = None
    ready: int | None = None


class PendingItems:
    """Items in order of their numbers, until they have their verdict.

    `judged` are numbers that have a verdict already, such as those of a stage before this one.
    `largest` is the largest number so far, 0 if there is none.
    """

    def __init__(self, judged: Iterable[int] = ()) -> None:
        self._pending: dict[int, PendingItem] = {}
        self._judged: deque[int] = deque(sorted(judged)[-MAX_JUDGED:])
        self._has_verdict = set(self._judged)
        self.passed_over: list[int] = []  # for the caller to take away
        self._forgotten = 0  # the largest number that had a verdict and is not kept
        self.largest = max(self._judged, default=0)

    def __iter__(self) -> Iterator[PendingItem]:
        return iter(list(self._pending.values()))

    def get(self, number: int) -> PendingItem | None:
        """Return the item of a number, None if it is not announced or has its verdict."""
        return self._pending.get(number)

    def announce(self, item: Item) -> PendingItem | None:
        """Add an announcement; return its item, None if that has its verdict."""
        pending = self._pending.get(item.item_id)
        if pending is not None:
            pending.item = item
            return pending
        if self.has_verdict(item.item_id):
            return None
        self.largest = max(self.largest, item.item_id)
        pending = self._pending[item.item_id] = PendingItem(item)
        return pending

    def has_verdict(self, number: int) -> bool:
        """Return whether the item of a number has its verdict."""
        return number in self._has_verdict or number <= self._forgotten

    def judge(self, number: int) -> None:
        """Remove an item: it has its verdict."""
        self._pending.pop(number, None)
        self._judged.append(number)
        self._has_verdict.add(number)
        self.largest = max(self.largest, number)
        if len(self._judged) > MAX_JUDGED:
            forgotten = self._judged.popleft()
            self._has_verdict.discard(forgotten)
            self._forgotten = max(self._forgotten, forgotten)

    def pass_over(self, number: int) -> None:
        """Remove an item whose product has its verdict under another number."""
        self.judge(number)
        self.passed_over.append(number)

    def free_number(self, after: int) -> int | None:
        """Return a number for an item that no segmenter announces, None if there is none.

        It follows `after`, the largest number when the item left. A segmenter that is started
        again goes on at the next multiple of `NUMBERS_AT_ONCE`, or the first time at 1: up to
        there the numbers are free.
        """
        number = after + 1
        while self.has_verdict(number) or number in self._pending:
            number += 1
        gap_end = (after // NUMBERS_AT_ONCE + 1) * NUMBERS_AT_ONCE
        return number if after > 0 and number < gap_end else None

    def on_belt(self, before: int | None = None) -> list[PendingItem]:
        """Return the items that are not complete, the oldest first; with `before` older ones."""
        return [
            each
            for number, each in sorted(self._pending.items())
            if not each.item.complete and (before is None or number < before)
        ]

    def too_many(self) -> list[PendingItem]:
        """Return the oldest items, those that are more than can be kept."""
        return list(self._pending.values())[: max(0, len(self._pending) - _MAX_PENDING)]

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items between the infeed eye and the rejector, with what is known of them."""

from collections.abc import Iterator
from dataclasses import dataclass
import time

from checkweigher_core.records import NANOSECONDS, Decision, Eye, EyeEdge, Item, Verdict
from checkweigher_dsp.rejection.outfeed_watch import FLICKER

_MAX_ITEMS = 200  # more are on no belt
_MAX_NAMES = 10


@dataclass(slots=True)
class BeltItem:
    """One item: its stamps at the infeed eye, its verdict if it has one, and where it is gone.

    `number` is 0 before it is announced or judged. `end` is the time of the belt at which it has
    passed the rejector, ns, None before its verdict.
    """

    entered: int | None
    cleared: int | None = None
    number: int = 0
    decision: Decision | None = None
    end: int | None = None
    told: bool = False  # that the line has to be stopped for it

    @property
    def passage(self) -> int | None:
        """Time for which it blocked the infeed eye, ns; None if that is not known."""
        if self.entered is None or self.cleared is None:
            return None
        return self.cleared - self.entered

    def __str__(self) -> str:
        name = f'item {self.number}' if self.number else 'a product'
        known = f'{name} without a verdict'
        if self.decision is not None:
            known = f'{name} {self.decision.name}'
        if self.entered is None:
            return known
        second, rest = divmod(self.entered, NANOSECONDS)
        clock = time.strftime('%H:%M:%S', time.localtime(second))
        return f'{known} (entered {clock}.{10 * rest // NANOSECONDS})'


class BeltItems:
    """Items in order of entry. Stamps are those of the eyes; `here` is the time of the belt, ns."""

    def __init__(self) -> None:
        self._items: list[BeltItem] = []

    def __iter__(self) -> Iterator[BeltItem]:
        return iter(self._items)

    def __bool__(self) -> bool:
        return bool(self._items)

    def edge(self, edge: EyeEdge) -> None:
        """Take an edge of the photo-eyes."""
        if edge.eye != Eye.INFEED:
            return
        last = self._items[-1] if self._items else None
        if not edge.blocked:
            if last is not None:
                last.cleared = edge.stamp
            return
        cleared = None if last is None else last.cleared
        if cleared is not None and 0 <= edge.stamp - cleared < FLICKER:
            return  # the same product
        self._items.append(BeltItem(edge.stamp))
        del self._items[:-_MAX_ITEMS]

    def announce(self, item: Item) -> None:
        """Add number and t2 of an announced item that the infeed eye showed, before its verdict."""
        found = self._find(item.t1)
        if found is not None and found.decision is None:
            found.number, found.cleared = item.item_id, item.t2 or found.cleared

    def _find(self, t1: int | None) -> BeltItem | None:
        return next((each for each in self._items if each.entered == t1 is not None), None)

    def judge(self, verdict: Verdict, end: int | None) -> BeltItem:
        """Take a verdict, and `end`; return the item. One whose place is not known is forgotten."""
        item = self._find(verdict.t1)
        if item is None:
            item = BeltItem(verdict.t1)  # first, so that its leaving drops no other item
            self._items.insert(0, item)
        item.number, item.decision, item.end = verdict.item_id, verdict.decision, end
        if end is None:
            self._items.remove(item)
        return item

    def leave(self, here: int) -> None:
        """Forget what has passed the rejector, with all that is in front of it."""
        ends = [each.end is not None and each.end <= here for each in self._items]
        if any(ends):
            gone = len(ends) - ends[::-1].index(True)
            self._items = [
                each
                for place, each in enumerate(self._items)
                if place >= gone or (each.end is not None and each.end > here)
            ]

    def clear(self) -> None:
        """Forget all."""
        self._items.clear()

    def names(self) -> tuple[str, ...]:
        """Return what a person has to look for."""
        names = tuple(str(each) for each in self._items[:_MAX_NAMES])
        more = len(self._items) - _MAX_NAMES
        return (*names, f'{more} more') if more > 0 else names

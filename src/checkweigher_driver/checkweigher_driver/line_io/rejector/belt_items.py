# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items that are between the infeed eye and the rejector."""

from collections.abc import Iterator
from dataclasses import dataclass
import time

from checkweigher_core.records import NANOSECONDS, Decision, Eye, EyeEdge, Item, Verdict
from checkweigher_dsp.rejection.outfeed_watch import FLICKER

_MAX_ITEMS = 200  # no belt carries more
_MAX_NAMES = 10


@dataclass(slots=True)
class BeltItem:
    """Item between the infeed eye and the rejector.

    `entered` and `cleared` are the stamps in ns at which the item has blocked and cleared the
    infeed eye. `number` is 0 as long as it is unknown. `end` is the belt time in ns at which the
    item has passed the rejector, None before its verdict. `reported` is true if the item has caused
    a stop.
    """

    entered: int | None
    cleared: int | None = None
    number: int = 0
    decision: Decision | None = None
    end: int | None = None
    reported: bool = False

    @property
    def passage(self) -> int | None:
        """Time in ns for which the item blocked the infeed eye, None if it is unknown."""
        if self.entered is None or self.cleared is None:
            return None
        return self.cleared - self.entered

    def __str__(self) -> str:
        name = f'item {self.number}' if self.number else 'a product'
        judged = 'without a verdict' if self.decision is None else self.decision.name
        if self.entered is None:
            return f'{name} {judged}'
        second, rest = divmod(self.entered, NANOSECONDS)
        clock = time.strftime('%H:%M:%S', time.localtime(second))
        return f'{name} {judged} (entered {clock}.{10 * rest // NANOSECONDS})'


class BeltItems:
    """Items between the infeed eye and the rejector, in order of entry."""

    def __init__(self) -> None:
        self._items: list[BeltItem] = []

    def __iter__(self) -> Iterator[BeltItem]:
        return iter(self._items)

    def __bool__(self) -> bool:
        return bool(self._items)

    def edge(self, edge: EyeEdge) -> None:
        """Process an edge of the photo-eyes."""
        if edge.eye != Eye.INFEED:
            return
        last = self._items[-1] if self._items else BeltItem(None)
        if not edge.blocked:
            last.cleared = edge.stamp
        elif last.cleared is None or not 0 <= edge.stamp - last.cleared < FLICKER:
            self._items.append(BeltItem(edge.stamp))
            del self._items[:-_MAX_ITEMS]

    def announce(self, item: Item) -> None:
        """Set number and t2 of an item on the belt that has no verdict yet."""
        found = self._find(item.t1)
        if found is not None and found.decision is None:
            found.number, found.cleared = item.item_id, item.t2 or found.cleared

    def _find(self, t1: int | None) -> BeltItem | None:
        return next((each for each in self._items if each.entered == t1 is not None), None)

    def judge(self, verdict: Verdict, end: int | None) -> BeltItem:
        """Set the verdict of an item, and return the item.

        `end` is the belt time in ns at which the item will have passed the rejector. If it is None,
        the item is removed.
        """
        item = self._find(verdict.t1)
        if item is None:
            item = BeltItem(verdict.t1)  # inserted in front, because `leave` removes earlier items
            self._items.insert(0, item)
        item.number, item.decision, item.end = verdict.item_id, verdict.decision, end
        if end is None:
            self._items.remove(item)
        return item

    def leave(self, here: int) -> None:
        """Remove the items that have passed the rejector at belt time `here` in ns.

        Items without a verdict in front of such an item are removed, too.
        """
        passed = [each.end is not None and each.end <= here for each in self._items]
        gone = max((place for place, is_gone in enumerate(passed, 1) if is_gone), default=0)
        self._items = [
            each
            for place, each in enumerate(self._items)
            if place >= gone or (each.end is not None and not passed[place])
        ]

    def clear(self) -> None:
        """Remove all items."""
        self._items.clear()

    def names(self) -> tuple[str, ...]:
        """Return the names of the items, by which a person can look for them."""
        names = tuple(str(each) for each in self._items[:_MAX_NAMES])
        more = len(self._items) - _MAX_NAMES
        return (*names, f'{more} more') if more > 0 else names

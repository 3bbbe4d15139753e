# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items that are between the infeed eye and the rejector."""

from dataclasses import dataclass
import time

from checkweigher_core.records import NANOSECONDS, Decision, Eye, EyeEdge, Item, Verdict
from checkweigher_dsp.rejection.outfeed_watch import FLICKER

_MAX_ITEMS = 200  # largest number of items; no belt carries more
_MAX_NAMES = 10


@dataclass(slots=True)
class BeltItem:
    """Item between the infeed eye and the rejector.

    `entered` and `cleared` are the stamps in ns at which the item has blocked and cleared the
    infeed eye, or None as long as they are unknown. `number` is 0 as long as it is unknown.
    `decision` is None before the verdict. `end` is the belt time in ns at which the item will have
    passed the rejector, or None before the verdict. `reported` is true if the item has already
    caused a stop.
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


class BeltItems(list[BeltItem]):
    """Items between the infeed eye and the rejector, in order of entry."""

    def edge(self, edge: EyeEdge) -> None:
        """Add an item if the infeed eye is blocked, or record that the last item has cleared it.

        Edges of the outfeed eye are ignored. If the infeed eye is blocked less than `FLICKER` after
        it was cleared, the edge belongs to the last item. If there are more than 200 items, the
        oldest item is removed.
        """
        if edge.eye != Eye.INFEED:
            return
        last = self[-1] if self else BeltItem(None)
        if not edge.blocked:
            last.cleared = edge.stamp
        elif last.cleared is None or not 0 <= edge.stamp - last.cleared < FLICKER:
            self.append(BeltItem(edge.stamp))
            del self[:-_MAX_ITEMS]

    def announce(self, item: Item) -> None:
        """Set the number of an item on the belt, and the time at which it cleared the infeed eye.

        If `item.t2` is unknown, the time is not changed. An item that is not on the belt, or that
        has a verdict already, is ignored.
        """
        found = self._find(item.t1)
        if found is not None and found.decision is None:
            found.number, found.cleared = item.item_id, item.t2 or found.cleared

    def _find(self, t1: int | None) -> BeltItem | None:
        return next((each for each in self if each.entered == t1 is not None), None)

    def judge(self, verdict: Verdict, end: int | None) -> BeltItem:
        """Set the verdict of an item, and return the item.

        `end` is the belt time in ns at which the item will have passed the rejector. If `end` is
        None, the item is removed. An item that is not on the belt is added before its verdict is
        set.
        """
        item = self._find(verdict.t1)
        if item is None:
            # Insert the item at the front; otherwise `leave` would also remove the items without a
            # verdict in front of the item.
            item = BeltItem(verdict.t1)
            self.insert(0, item)
        item.number, item.decision, item.end = verdict.item_id, verdict.decision, end
        if end is None:
            self.remove(item)
        return item

    def leave(self, here: int) -> None:
        """Remove the items that have passed the rejector at belt time `here` in ns.

        Items without a verdict in front of a removed item are removed, too.
        """
        passed = [each.end is not None and each.end <= here for each in self]
        gone = max((place for place, is_gone in enumerate(passed, 1) if is_gone), default=0)
        self[:] = [
            each
            for place, each in enumerate(self)
            if place >= gone or (each.end is not None and not passed[place])
        ]

    def names(self) -> tuple[str, ...]:
        """Return the names of at most ten items, then the number of further items as "N more"."""
        names = tuple(str(each) for each in self[:_MAX_NAMES])
        more = len(self) - _MAX_NAMES
        return (*names, f'{more} more') if more > 0 else names

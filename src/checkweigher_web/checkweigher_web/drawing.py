# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Caches of figures and tables. The page computes each figure and table once for all viewers."""

from collections.abc import Callable, Hashable
import time
from typing import Any, TypeVar

from checkweigher_web.lane import Lane, ShownItem
from checkweigher_web.shift import Shift

T = TypeVar('T')


class Made:
    """Cache of objects that all viewers share, so that twenty viewers cost little more than one.

    The cache has no lock, so only the page thread may use it.
    """

    def __init__(self) -> None:
        self._made: dict[Hashable, tuple[object, Any]] = {}

    def once(self, name: Hashable, state: object, make: Callable[[], T]) -> T:
        """Return the cached object `name`, or a new object from `make` if `state` has changed."""
        known = self._made.get(name)
        if known is None or known[0] != state:
            known = self._made[name] = state, make()
        return known[1]

    def each_second(self, name: Hashable, make: Callable[[], T]) -> T:
        """Return the cached object `name`, and call `make` for it at most once per second."""
        return self.once(name, int(time.monotonic()), make)


class Drawing(Made):
    """Cache of the figures and tables of a lane or a recorded shift."""

    def __init__(self, lane: Lane | Shift) -> None:
        super().__init__()
        self.lane = lane

    def items(self, *, only_faults: bool = False) -> list[ShownItem]:
        """Return the items, or only the faults, without their signals. The latest item is first."""
        make = self.lane.faults if only_faults else self.lane.items
        return self.once(('items', only_faults), self.lane.version, make)

    def latest(self) -> ShownItem | None:
        """Return the latest item, or None if there is no item."""
        return next(iter(self.items()), None)

    def of_items(self) -> object:
        """Return a value that changes when the latest item, the product or the batch changes."""
        return self.once('state', self.lane.version, self._of_items)

    def _of_items(self) -> object:
        latest, known = self.latest(), self.lane.statistics
        return latest and latest.key, known and (known.product, known.batch)


def row_key(item: ShownItem) -> str:
    """Return the key of an item as text, because JavaScript would round a stamp in ns.

    The text also contains the item number, so that the keys of two items without times differ.
    """
    return f'{item.verdict.item_id}/{item.key[0]}/{item.key[1]}'

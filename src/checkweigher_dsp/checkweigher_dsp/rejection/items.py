# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The items that wait for their verdict and those that have it, with their numbers."""

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from checkweigher_dsp.items.item import Item
from checkweigher_dsp.records import MassEstimate, Verdict

_MAX_PENDING = 10_000
_MAX_JUDGED = 1_000
# A number that is further ahead than this is no count of items.
_MAX_AHEAD = 10_000
_MAX_NUMBER = 2**62


class ItemState(Enum):
    """Where an item is on its way to its verdict.

    WAITING becomes JUDGED with its mass, or when it can wait no longer. An item whose mass was
    faster than the edge that shows it to this stage is UNSEEN, and JUDGED with that edge. What
    others have judged is UNSEEN: the eyes may show it once more.
    """

    WAITING = 'it has no verdict yet'
    UNSEEN = 'it has a verdict, and the eyes have not shown it to this stage'
    JUDGED = 'it has a verdict'


@dataclass(slots=True, eq=False)
class RejectItem:
    """One item on its way to the rejector; all times in ns."""

    t1: int | None
    t2: int | None
    t3: int | None
    state: ItemState = ItemState.WAITING
    count: int | None = None  # number by the eyes, None until they have shown it
    reasons: tuple[str, ...] = ()  # what the eyes say against it
    reject_at: int | None = None  # when the rejector has to be told
    # On the clock of arrivals: when a verdict can wait no longer, and when it is too late.
    due: int | None = None
    late_from: int | None = None
    # By its mass, with the estimate, while inspection devices have yet to answer; until when.
    held: tuple[Verdict, MassEstimate] | None = None
    ready: int | None = None
    number: int = 0  # of the verdict; 0 if there is none, as the next one
    estimate_id: int = 0  # of the estimate that it rests on
    stream: int = 0  # in which it was judged


_Stamped = Item | MassEstimate | RejectItem


def edges_of(item: _Stamped) -> dict[str, int]:
    """Return the known stamps of an item, ns, by their names."""
    known = (('t1', item.t1), ('t2', item.t2), ('t3', item.t3))
    return {name: stamp for name, stamp in known if stamp is not None}


def same(one: _Stamped, other: _Stamped) -> bool:
    """Tell whether two items are one: an edge belongs to one item only, so one stamp is enough.

    Items that have entered apart are two: the stages may have paired them with another t3.
    """
    if one.t1 is not None and other.t1 is not None:
        return one.t1 == other.t1
    if one.t2 is not None and other.t2 is not None:
        return one.t2 == other.t2
    return one.t3 is not None and one.t3 == other.t3


class RejectItems:
    """Items on the line, each under one number.

    Numbers follow those of the estimates as long as these go forward, so that both are the same
    in a line whose nodes all run from the start. No number of the last thousand items, and
    none below those, is given again.
    """

    def __init__(self) -> None:
        self.pending: list[RejectItem] = []  # those that have no verdict yet
        self._judged: OrderedDict[int, RejectItem] = OrderedDict()  # by number
        self._unseen: dict[int, RejectItem] = {}  # of these those in that state
        self._largest = 0
        self._forgotten = 0
        self._ahead = 0  # of the count by the eyes
        self._stream = 0
        # Edges of this stream that have a verdict, a set in their order.
        self._used: OrderedDict[tuple[str, int], None] = OrderedDict()

    def restart(self) -> None:
        """Begin a new stream: the same stamps may come again."""
        self._stream += 1
        self._used.clear()

    def too_many(self) -> list[RejectItem]:
        """Return the oldest items, those that are more than can be kept."""
        return self.pending[: max(0, len(self.pending) - _MAX_PENDING)]

    def find_pending(self, estimate: MassEstimate) -> RejectItem | None:
        """Return the item without a verdict that an estimate is of."""
        return next((item for item in self.pending if same(item, estimate)), None)

    def find_held(self, seen: Item) -> RejectItem | None:
        """Return the item of what the eyes show whose mass was faster, and waits for a device."""
        held = (item for item in self.pending if item.held is not None and item.count is None)
        return next((item for item in held if same(item, seen)), None)

    def has_judged(self, estimate: MassEstimate) -> bool:
        """Tell whether the item of an estimate had its verdict before the estimate came.

        The stamps of a recording come again when it is played again: then the number differs. It
        does so as well where a segmenter was started with the item on the belt, but in one stream.
        Which edges are its own is not known of an item that is a fault by its edges.
        """
        if not estimate.weighed and self.is_used_up(estimate):
            return True
        for item in reversed(self._judged.values()):
            whole = item.state is ItemState.JUDGED and not item.reasons
            again = whole and item.stream == self._stream and not estimate.weighed
            if same(item, estimate) and (again or item.estimate_id in (0, estimate.item_id)):
                item.estimate_id = estimate.item_id
                return True
        return False

    def is_used_up(self, item: _Stamped) -> bool:
        """Tell whether each edge of an item has a verdict: it is no further one.

        Where edges are missing the stages may have paired the others differently.
        """
        edges = edges_of(item)
        return bool(edges) and all(edge in self._used for edge in edges.items())

    def has_seen(self, seen: Item) -> bool:
        """Tell whether an item that the eyes show has its verdict already, and count it as that."""
        for item in reversed(self._unseen.values()):
            if same(item, seen):
                del self._unseen[item.number]
                item.state, item.count = ItemState.JUDGED, seen.item_id
                item.reasons = tuple(reason.value for reason in seen.faults)
                self._ahead = max(self._ahead, item.number - item.count)
                self._use(item)
                if item.t3 is not None and seen.t3 is not None and item.t3 != seen.t3:
                    return True  # the eyes show the t3 of something else, which has no verdict yet
                if not seen.faults:  # the estimate may have been of a part of it
                    item.t1, item.t2, item.t3 = seen.t1, seen.t2, seen.t3
                self._use(seen)
                return True
        return self.is_used_up(seen)

    def _use(self, item: _Stamped) -> None:
        self._used.update(dict.fromkeys(edges_of(item).items()))
        while len(self._used) > 3 * _MAX_JUDGED:
            self._used.popitem(last=False)

    def judge(self, item: RejectItem, estimate: _Stamped | None, estimate_id: int) -> int:
        """Note that an item has its verdict now and return its number."""
        self._use(item)
        if estimate is not None:
            self._use(estimate)
        number = max(self._wanted_number(item, estimate_id), self._forgotten + 1)
        while number in self._judged:
            number += 1
        if item.count is None:
            item.state = ItemState.UNSEEN
        else:
            item.state = ItemState.JUDGED
            self._ahead = max(self._ahead, number - item.count)
        item.number, item.estimate_id, item.stream = number, estimate_id, self._stream
        self._largest = max(self._largest, number)
        self.pending.remove(item)
        self._remember(item)
        return number

    def recall(self, verdicts: Iterable[Verdict], last_number: int = 0) -> None:
        """Note what others have judged, and begin to count by the eyes again.

        What was judged before the first of them has lower numbers; neither these nor any up to
        `last_number` are given again.
        """
        known = [verdict for verdict in verdicts if 0 < verdict.item_id < _MAX_NUMBER]
        for verdict in known:
            number = verdict.item_id
            if number not in self._judged:
                self._largest = max(self._largest, number)
                item = RejectItem(verdict.t1, None, verdict.t3, ItemState.UNSEEN)
                item.number, item.estimate_id = number, verdict.estimate_id
                self._remember(item)
        for item in self._judged.values():
            item.state, item.count = ItemState.UNSEEN, None  # the eyes may show it once more
        self._unseen = dict(self._judged)
        first = min((verdict.item_id for verdict in known), default=1)
        last_number = last_number if last_number < _MAX_NUMBER else 0
        self._forgotten = max(self._forgotten, first - 1, last_number)
        self._ahead = 0

    def _remember(self, item: RejectItem) -> None:
        self._judged[item.number] = item
        if item.state is ItemState.UNSEEN:
            self._unseen[item.number] = item
        if len(self._judged) > _MAX_JUDGED:
            forgotten, _ = self._judged.popitem(last=False)
            self._unseen.pop(forgotten, None)
            self._forgotten = max(self._forgotten, forgotten)

    def _wanted_number(self, item: RejectItem, estimate_id: int) -> int:
        if item.count is None:
            near = abs(estimate_id - self._largest) <= _MAX_AHEAD
            return estimate_id if estimate_id > 0 and near else self._largest + 1
        own = item.count + self._ahead
        # The first number shows how many items there were before this stage was started.
        limit = own + _MAX_AHEAD if self._largest else _MAX_NUMBER
        return estimate_id if own <= estimate_id <= limit else own

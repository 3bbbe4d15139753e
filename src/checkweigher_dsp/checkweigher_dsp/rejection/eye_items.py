# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The items that the photo-eyes show to the reject stage, stream after stream of edges."""

from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
import math

from checkweigher_dsp.items.item import Item
from checkweigher_dsp.items.tracking import ItemTracker
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import NANOSECONDS, EyeEdge, LineHistory, MassEstimate
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.timing import RESTART, ArrivalClock

_PLAYED_AGAIN = 4  # edges, as many as an item has
_MAX_EARLY = 10_000
_MAX_STAMPS = 4_000
_MAX_LATEST = 400
Arrival = tuple[EyeEdge, int | None]  # an edge and when it came


@dataclass(slots=True)
class _Stream:
    """State of one stream by its edges; stamps and times of arrival in ns."""

    newest: int | None = None  # the youngest stamp
    came: int | None = None  # when the youngest edge came
    held: list[Arrival] = field(default_factory=list)  # edges that came before, long ago
    arrivals: ArrivalClock = field(default_factory=ArrivalClock)

    def saw(self, edge: EyeEdge, now: int | None) -> int | None:
        """Take an edge; return when it should have come."""
        self.held.clear()
        stamp = edge.stamp
        if self.newest is None or stamp >= self.newest:
            self.newest, self.came = stamp, now
        return None if now is None else self.arrivals.came(stamp, now)


class EyeItems:
    """Count the items by the edges of the eyes, in any order and over restarts of the driver.

    Times are in ns; `now` is when something came, on any clock that never steps back.

    Parameters
    ----------
    parameters : RejectParameters
        Debounce time, least speed and how late an edge may come.
    weigh_length : float, optional
        m, between the eyes. Edges that come before it is known are kept.

    Attributes
    ----------
    parameters : RejectParameters
        They may be replaced between two edges.
    weigh_length : float or None
        m; `set_weigh_length` changes it.
    """

    def __init__(self, parameters: RejectParameters, weigh_length: float | None = None) -> None:
        self.parameters = parameters
        self.weigh_length = weigh_length
        self._tracker: ItemTracker | None = None
        self._stream = _Stream()
        self._early: deque[Arrival] = deque(maxlen=_MAX_EARLY)
        self._latest: deque[Arrival] = deque(maxlen=_MAX_LATEST)
        self._stamps: OrderedDict[int, None] = OrderedDict()  # of the latest edges, a set
        if weigh_length is not None:
            self._tracker = self._new_tracker(weigh_length, 0)

    @property
    def arrivals(self) -> ArrivalClock:
        """When edges of this stream come."""
        return self._stream.arrivals

    @property
    def next_missing(self) -> int | None:
        """Time after which an item that has not reached the outfeed eye never will."""
        overdue = self._tracker.overdue_after if self._tracker is not None else None
        newest, came = self._stream.newest, self._stream.came
        if overdue is None or newest is None or came is None:
            return None
        return came + overdue + self._lateness - newest + 1

    def set_weigh_length(self, weigh_length: float) -> list[Arrival]:
        """Take the distance between the eyes, m; return the edges that came before it was known."""
        count = self._tracker.count if self._tracker is not None else 0
        self.weigh_length = weigh_length
        self._tracker = self._new_tracker(weigh_length, count)
        early = list(self._early)
        self._early.clear()
        return early

    def keep_early(self, edge: EyeEdge, now: int | None) -> bool:
        """Keep an edge while the distance between the eyes is not known; tell whether it is so."""
        if self._tracker is None:
            self._early.append((edge, now))
        return self._tracker is None

    def begin_stream(self, reason: Reason) -> list[Item]:
        """Forget the stream; return what was on the belt, each item a fault for that reason."""
        items = self.give_up(reason)
        if self._tracker is not None:
            self._tracker.forget()
        self._stream = _Stream()
        return items

    def give_up(self, reason: Reason) -> list[Item]:
        """Return what is on the belt: no further edge of it is waited for."""
        return [] if self._tracker is None else self._tracker.give_up(reason)

    def goes_back(self, edge: EyeEdge) -> bool:
        """Tell whether an edge is so old that it is of another stream, or comes once more."""
        newest = self._stream.newest
        return newest is not None and edge.stamp < newest - RESTART

    def hold_known(self, edge: EyeEdge, now: int | None) -> bool:
        """Hold an old edge if it has come before; False if it is a new one."""
        known = self._tracker is not None and self._tracker.knows(edge)
        if known:
            self._stream.held.append((edge, now))
        return known

    def played_again(self) -> list[Arrival]:
        """Return the edges that were held, once they are so many that all are played again."""
        held = self._stream.held
        return list(held) if len(held) >= _PLAYED_AGAIN else []

    def follow(self, edge: EyeEdge, now: int | None = None) -> tuple[int | None, list[Item]]:
        """Take an edge of this stream; return when it should have come, and what it finishes."""
        assert self._tracker is not None
        came = self._stream.saw(edge, now)
        self._latest.append((edge, now))
        self._stamps[edge.stamp] = None
        if len(self._stamps) > _MAX_STAMPS:
            self._stamps.popitem(last=False)
        return came, self._tracker.add(edge)

    def expire(self, now: int) -> list[Item]:
        """Give up what should have reached the outfeed eye, as if an edge had come that late."""
        newest, came = self._stream.newest, self._stream.came
        if self._tracker is None or newest is None or came is None:
            return []
        return self._tracker.expire(newest + now - came - self._lateness)

    def learn_transit(self, estimate: MassEstimate) -> None:
        """Take from the segmenter, which sees the load, how edges are to be paired."""
        if self._tracker is None or estimate.t1 is None or estimate.t3 is None:
            return
        if estimate.weighed and {estimate.t1, estimate.t3} <= self._stamps.keys():
            self._tracker.set_usual_transit(estimate.t3 - estimate.t1)

    def knows_any(self, stamps: Iterable[int]) -> bool:
        """Tell whether one of these is the stamp of an edge that came lately."""
        return any(stamp in self._stamps for stamp in stamps)

    def is_entry_unseen(self, estimate: MassEstimate) -> bool:
        """Tell whether the eyes saw t1 of an item on the belt, and the segmenter missed it."""
        if self._tracker is None or estimate.t2 is None:
            return False
        if estimate.t1 is not None or estimate.t3 is not None:
            return False
        item = self._tracker.on_belt(estimate.t2)
        return item is not None and item.t1 is not None

    def may_come(self, stamp: int) -> bool:
        """Tell whether an edge of that stamp can still be on its way."""
        newest = self._stream.newest
        return newest is None or newest - self._lateness < stamp

    def speed(self, t1: int | None, t3: int | None, usual_transit: int | None = None) -> float:
        """Return the belt speed by the edges of an item, or else by a usual transit, ns; in m/s.

        NaN if neither is known.
        """
        transit = usual_transit
        if t1 is not None and t3 is not None and t3 > t1:
            transit = t3 - t1
        if self.weigh_length is None or not transit:
            return math.nan
        return self.weigh_length * NANOSECONDS / transit

    def forget_latest(self) -> None:
        """Forget the latest edges: a history that comes now is of later ones."""
        self._latest.clear()

    def missed(
        self, history: LineHistory, live: Iterable[Arrival]
    ) -> tuple[list[EyeEdge], list[Arrival]]:
        """Return which edges of a driver's history have not come, and those to take after them.

        `live` are edges that have come and were not taken yet. Where some were missed, those
        that were taken come again behind them.
        """
        live = list(live)
        known = {edge for edge, _ in (*self._latest, *live)}
        begin = next((n for n, e in enumerate(history.edges) if e in known), len(history.edges))
        missed = list(history.edges[:begin]) if self.weigh_length is not None else []
        return missed, [*self._latest, *live] if missed else live

    def count_again(self) -> None:
        """Count from 0 again; the stream goes on."""
        assert self.weigh_length is not None
        self._tracker = self._new_tracker(self.weigh_length, 0)
        self._stream = _Stream(held=self._stream.held, arrivals=self._stream.arrivals)

    def caught_up(self, came: int | None) -> None:
        """Note that the edges that were missed are in, the youngest of them as if it came then."""
        if came is not None:
            self._stream.came = came
        self._latest.clear()

    @property
    def _lateness(self) -> int:
        return round(NANOSECONDS * self.parameters.edge_lateness)

    def _new_tracker(self, weigh_length: float, count: int) -> ItemTracker:
        return ItemTracker(
            round(NANOSECONDS * self.parameters.debounce_time),
            self.parameters.max_transit(weigh_length),
            count,
        )

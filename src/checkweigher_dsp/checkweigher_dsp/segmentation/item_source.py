# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The items of the line, in the order in which the eyes are done with them."""

from collections.abc import Iterable
import math

from checkweigher_core.records import NANOSECONDS, EyeEdge, Item, LoadCell
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.items.edge_queue import EdgeQueue
from checkweigher_dsp.items.item import TrackedItem
from checkweigher_dsp.items.tracking import ItemTracker
from checkweigher_dsp.segmentation.load_check import is_unloaded
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_keeper import ZeroKeeper


class ItemSource:
    """Keep edges until the samples have reached them, and pair them to items.

    Items are returned as the eyes have shown them by then: later edges do not change them. Each is
    announced before: once its number is settled, and once it is complete.
    """

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters,
        buffer: SampleBuffer, zero: ZeroKeeper, item_count: int,
    ) -> None:  # fmt: skip
        known = parameters.product_length > 0
        self._buffer = buffer
        self._zero = zero
        self._weigh_length = load_cell.weigh_length
        self._announced: list[Item] = []
        self._moment = round(parameters.zero_moment * load_cell.sample_rate)
        self._lateness = round(NANOSECONDS * parameters.edge_lateness)
        self._sample_lateness = round(NANOSECONDS * parameters.sample_lateness)
        self._queue = EdgeQueue(self._lateness)
        self.tracker = ItemTracker(
            round(NANOSECONDS * parameters.debounce_time),
            parameters.max_transit(load_cell.weigh_length),
            item_count,
            load_cell.weigh_length / parameters.product_length if known else 0.0,
            self._is_unloaded,
        )

    def take_announced(self) -> list[Item]:
        """Return the announcements since the last call, in their order."""
        announced, self._announced = self._announced, []
        return announced

    @property
    def edges_wait(self) -> bool:
        """Whether edges wait for their samples."""
        return not self._queue.is_empty

    def add(self, edge: EyeEdge) -> list[TrackedItem]:
        """Take an edge and return the items whose last edge the samples have reached."""
        self._queue.add(edge)
        return self._reached()

    def advance(self) -> list[TrackedItem]:
        """Return the items that more samples have reached, and those that must have left by now."""
        buffer, tracker = self._buffer, self.tracker
        tracker.begin(buffer.origin)
        self._queue.admit_strays()  # these samples are of the clock of those before
        items = self._forget_future() + self._reached()
        now = buffer.last_stamp if tracker.overdue_after is not None else None
        if now is not None:
            items += self._announce(tracker.expire(now - self._lateness))
        return items

    def _forget_future(self) -> list[TrackedItem]:
        """Drop edges of a time that samples reach later than any may come; return what that costs.

        If such edges were tracked already, by edges of a time even later, no true edge would be
        the youngest any more.
        """
        last, newest = self._buffer.last_stamp, self.tracker.newest
        if last is None:
            return []
        limit = last + self._sample_lateness
        self._queue.drop_after(limit)
        if newest is None or newest <= limit:
            return []
        items = self.give_up(Reason.CLOCK_JUMP)
        self.tracker.forget()
        return items

    def track_waiting(self) -> list[TrackedItem]:
        """Return the items of the edges that wait for samples: these have stalled."""
        return self._track(self._queue.pop_while(lambda edge: True))

    def give_up_before(self, limit: int) -> list[TrackedItem]:
        """Return the items of edges before `limit`, ns, for which no samples come any more."""
        return self._track(self._queue.pop_while(lambda edge: edge.stamp < limit))

    def finish_edges(self) -> list[TrackedItem]:
        """Return the items of all edges, whether samples have reached them or not."""
        return self._track(self._queue.pop_all())

    def give_up(self, reason: Reason) -> list[TrackedItem]:
        """Return the items on the belt, with `reason`: nothing more will come of them."""
        return self._announce(self.tracker.give_up(reason))

    def edges_of_new_clock(self, stamp: int, *, forward: bool) -> list[EyeEdge]:
        """Take out the edges of a clock that jumps to `stamp`, ns, forward or back."""
        return self._queue.pop_of_new_clock(stamp, forward=forward)

    def change_clock(self, edges: Iterable[EyeEdge], *, forward: bool) -> None:
        """Go on by another clock, with those of its edges that have come already."""
        self._queue.put_back(edges)
        self.tracker.forget(backwards=not forward)

    def _reached(self) -> list[TrackedItem]:
        buffer = self._buffer
        if buffer.empty:
            return []
        return self._track(
            self._queue.pop_while(lambda edge: buffer.index_at(edge.stamp) <= buffer.end)
        )

    def _track(self, edges: Iterable[EyeEdge]) -> list[TrackedItem]:
        return [item for edge in edges for item in self._announce(self.tracker.add(edge))]

    def _announce(self, finished: Iterable[TrackedItem]) -> list[TrackedItem]:
        """Announce what is new by now; return the finished items as they are now."""
        items = [item.snapshot() for item in finished]
        self._announced += map(self._announcement, self.tracker.take_settled())
        self._announced += [self._announcement(item, complete=True) for item in items]
        return items

    def _announcement(self, item: TrackedItem, *, complete: bool = False) -> Item:
        stamp = next((each for each in (item.t1, item.t2, item.t3) if each is not None), None)
        transit = item.usual_transit or self.tracker.usual_transit
        if item.t1 is not None and item.t3 is not None and item.t3 > item.t1:
            transit = item.t3 - item.t1
        speed = self._weigh_length * NANOSECONDS / transit if transit else math.nan
        reasons = tuple(reason.value for reason in item.faults)
        return Item(stamp, 0, item.item_id, item.t1, item.t2, item.t3, speed, complete, reasons)

    def _is_unloaded(self, since: int, stamp: int) -> bool:
        """Tell whether what came onto the belt since a time has left it by another one, ns."""
        buffer = self._buffer
        if buffer.empty:
            return False
        begin, end = buffer.index_at(since), buffer.index_at(stamp)
        if not buffer.is_whole(begin, end):
            return False
        return is_unloaded(buffer.look_at(begin, end), self._moment, self._zero.zero.counts)

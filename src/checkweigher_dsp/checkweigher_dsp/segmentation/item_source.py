# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Source of the tracked items of a line, in the order in which they are finished or given up."""

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
    """Source of items from photo-eye edges. An edge waits for the samples of the same time.

    Items are returned as copies, which later edges do not change. Each item is announced by two
    `Item` records: when its number is final, and when the item is finished or given up.
    """

    def __init__(
        self,
        load_cell: LoadCell,
        parameters: SegmenterParameters,
        buffer: SampleBuffer,
        zero: ZeroKeeper,
        item_count: int,
    ) -> None:
        self._buffer = buffer
        self._zero = zero
        self._weigh_length = load_cell.weigh_length
        self._announced: list[Item] = []
        self._moment = round(parameters.zero_moment * load_cell.sample_rate)
        self._lateness = round(NANOSECONDS * parameters.edge_lateness)
        self._sample_lateness = round(NANOSECONDS * parameters.sample_lateness)
        self.queue = EdgeQueue(self._lateness)
        self.tracker = ItemTracker(
            round(NANOSECONDS * parameters.debounce_time),
            parameters.max_transit(load_cell.weigh_length),
            item_count,
            load_cell.weigh_length / parameters.product_length
            if parameters.product_length
            else 0.0,
            self._is_unloaded,
        )

    def take_announced(self) -> list[Item]:
        """Return the announcements since the last call, in order."""
        announced, self._announced = self._announced, []
        return announced

    def add(self, edge: EyeEdge) -> list[TrackedItem]:
        """Add an edge, and process the edges whose samples have arrived.

        Returns the items that are finished or given up.
        """
        self.queue.add(edge)
        return self._reached()

    def advance(self) -> list[TrackedItem]:
        """Process edges whose samples have arrived, and return the items finished or given up."""
        buffer, tracker = self._buffer, self.tracker
        tracker.eyes.origin = buffer.origin
        self.queue.admit_strays()  # The new samples show that the clock has not changed.
        now = buffer.last_stamp
        items = self._forget_after(now + self._sample_lateness) + self._reached()
        return items + self._announce(tracker.expire(now - self._lateness))

    def _forget_after(self, limit: int) -> list[TrackedItem]:
        """Discard edges after `limit`, in ns, and return the items that are given up.

        If edges after `limit` were already assigned to items, all items on the belt are given up
        and tracking begins again, because otherwise all correct edges would be late.
        """
        self.queue.drop_after(limit)
        if self.tracker.eyes.newest is None or self.tracker.eyes.newest <= limit:
            return []
        items = self.give_up(Reason.CLOCK_JUMP)
        self.tracker.forget()
        return items

    def track_before(self, limit: float = math.inf) -> list[TrackedItem]:
        """Process the edges before `limit`, in ns, without waiting for their samples.

        Returns the items that are finished or given up.
        """
        return self._track(self.queue.pop_while(lambda edge: edge.stamp < limit))

    def finish_edges(self) -> list[TrackedItem]:
        """Process all edges, including strays, without waiting for their samples.

        Returns the items that are finished or given up.
        """
        return self._track(self.queue.pop_all())

    def give_up(self, reason: Reason) -> list[TrackedItem]:
        """Give up all items on the belt as faults with a reason, and return copies of them."""
        return self._announce(self.tracker.give_up(reason))

    def _reached(self) -> list[TrackedItem]:
        buffer = self._buffer
        if buffer.empty:
            return []
        edges = self.queue.pop_while(lambda edge: buffer.index_at(edge.stamp) <= buffer.end)
        return self._track(edges)

    def _track(self, edges: Iterable[EyeEdge]) -> list[TrackedItem]:
        return [item for edge in edges for item in self._announce(self.tracker.add(edge))]

    def _announce(self, finished: Iterable[TrackedItem]) -> list[TrackedItem]:
        """Announce items and return copies of the finished items."""
        items = [item.snapshot() for item in finished]
        self._announced += map(self._announcement, self.tracker.take_settled())
        self._announced += [self._announcement(item, complete=True) for item in items]
        return items

    def _announcement(self, item: TrackedItem, *, complete: bool = False) -> Item:
        transit = item.usual_transit or self.tracker.belt.transit.value
        if item.t1 is not None and item.t3 is not None and item.t3 > item.t1:
            transit = item.t3 - item.t1
        speed = self._weigh_length * NANOSECONDS / transit if transit else math.nan
        reasons = tuple(reason.value for reason in item.faults)
        return Item(
            item.entered, 0, item.item_id, item.t1, item.t2, item.t3, speed, complete, reasons
        )

    def _is_unloaded(self, since: int, stamp: int) -> bool:
        """Return whether the load shows that all items that entered from `since` on have left.

        The samples from `since` to `stamp`, both in ns, give the load. If a sample is missing, or
        if there are fewer samples than in twice ``zero_moment``, the result is False.
        """
        buffer = self._buffer
        if buffer.empty:
            return False
        begin, end = buffer.index_at(since), buffer.index_at(stamp)
        return buffer.is_whole(begin, end) and is_unloaded(
            buffer.look_at(begin, end), self._moment, self._zero.zero.counts
        )

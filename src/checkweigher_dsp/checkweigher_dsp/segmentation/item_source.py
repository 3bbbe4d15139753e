# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The items of the line, in the order in which the eyes are done with them."""

from collections.abc import Iterable

from checkweigher_dsp.items.edge_queue import EdgeQueue
from checkweigher_dsp.items.item import Item
from checkweigher_dsp.items.tracking import ItemTracker
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import NANOSECONDS, EyeEdge, LoadCell
from checkweigher_dsp.segmentation.load_check import is_unloaded
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_keeper import ZeroKeeper


class ItemSource:
    """Keep edges until the samples have reached them, and pair them to items.

    Items are returned as the eyes have shown them by then: later edges do not change them.
    """

    def __init__(
        self, load_cell: LoadCell, parameters: SegmenterParameters,
        buffer: SampleBuffer, zero: ZeroKeeper, item_count: int,
    ) -> None:  # fmt: skip
        known = parameters.product_length > 0
        self._buffer = buffer
        self._zero = zero
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

    def add(self, edge: EyeEdge) -> list[Item]:
        """Take an edge and return the items whose last edge the samples have reached."""
        self._queue.add(edge)
        return self._reached()

    def advance(self) -> list[Item]:
        """Return the items that more samples have reached, and those that must have left by now."""
        buffer, tracker = self._buffer, self.tracker
        tracker.begin(buffer.origin)
        self._queue.admit_strays()  # these samples are of the clock of those before
        items = self._forget_future() + self._reached()
        now = buffer.last_stamp if tracker.overdue_after is not None else None
        if now is not None:
            items += [item.snapshot() for item in tracker.expire(now - self._lateness)]
        return items

    def _forget_future(self) -> list[Item]:
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

    def give_up_before(self, limit: int) -> list[Item]:
        """Return the items of edges before `limit`, ns, for which no samples come any more."""
        return self._track(self._queue.pop_while(lambda edge: edge.stamp < limit))

    def finish_edges(self) -> list[Item]:
        """Return the items of all edges, whether samples have reached them or not."""
        return self._track(self._queue.pop_all())

    def give_up(self, reason: Reason) -> list[Item]:
        """Return the items on the belt, with `reason`: nothing more will come of them."""
        return [item.snapshot() for item in self.tracker.give_up(reason)]

    def edges_of_new_clock(self, stamp: int, *, forward: bool) -> list[EyeEdge]:
        """Take out the edges of a clock that jumps to `stamp`, ns, forward or back."""
        return self._queue.pop_of_new_clock(stamp, forward=forward)

    def change_clock(self, edges: Iterable[EyeEdge], *, forward: bool) -> None:
        """Go on by another clock, with those of its edges that have come already."""
        self._queue.put_back(edges)
        self.tracker.forget(backwards=not forward)

    def _reached(self) -> list[Item]:
        buffer = self._buffer
        if buffer.empty:
            return []
        return self._track(
            self._queue.pop_while(lambda edge: buffer.index_at(edge.stamp) <= buffer.end)
        )

    def _track(self, edges: Iterable[EyeEdge]) -> list[Item]:
        return [item.snapshot() for edge in edges for item in self.tracker.add(edge)]

    def _is_unloaded(self, since: int, stamp: int) -> bool:
        """Tell whether what came onto the belt since a time has left it by another one, ns."""
        buffer = self._buffer
        if buffer.empty:
            return False
        begin, end = buffer.index_at(since), buffer.index_at(stamp)
        if not buffer.is_whole(begin, end):
            return False
        return is_unloaded(buffer.look_at(begin, end), self._moment, self._zero.zero.counts)

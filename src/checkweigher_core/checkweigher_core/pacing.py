# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Due times of the events of a recording or a simulation, and flow control between nodes."""

from collections import deque
from dataclasses import dataclass, field
from itertools import islice

from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock


@dataclass
class Pacer:
    """Conversion of stamps to due times on another clock.

    A block is due when its last sample has been taken. At rate 0 all events are due at once.
    """

    rate: float  # s of signal per second
    sample_rate: float  # Hz
    start: float  # s, due time of the first event
    _first_stamp: int | None = field(default=None, init=False)

    def due(self, event: Event) -> float:
        """Return the due time of an event in s."""
        if self._first_stamp is None:
            self._first_stamp = event.stamp
        if self.rate == 0:
            return self.start
        signal = (event.stamp - self._first_stamp) / NANOSECONDS
        if isinstance(event, SampleBlock):
            signal += len(event.counts) / self.sample_rate
        return self.start + signal / self.rate


@dataclass(eq=False)
class FlowControl:
    """Limits of the lag of the line behind the driver, which waits while a limit is exceeded.

    The lag is computed from the counts that the segmenter reports, so that it does not depend on
    the depth of the queues. It counts samples and edges separately, because DDS may delay the
    topic of either. Threads that use it must share a lock.
    """

    max_duration: float = 1.0  # s of signal; below the delay of edges that the segmenter accepts
    max_blocks: int = 500  # below the depth of the queue
    max_edges: int = 500  # below the depth of the queue
    max_items: int = 100  # between segmenter and verdict

    def __post_init__(self) -> None:
        self.samples_sent = 0
        self.items_judged = 0
        self._edges: deque[int] = deque()  # stamps of edges not taken yet
        self._samples_taken = self._edges_taken = self._items_cut = 0
        self._samples_missed = 0  # sent before this segmenter started

    def sent(self, event: Event) -> None:
        """Count an event that is about to be sent."""
        if isinstance(event, SampleBlock):
            self.samples_sent += len(event.counts)
        elif isinstance(event, EyeEdge):
            self._edges.append(event.stamp)

    def taken(self, samples: int, edges: int, items: int) -> None:
        """Process the total counts of the segmenter."""
        if samples < self._samples_taken or edges < self._edges_taken:
            # The segmenter was restarted and does not get earlier events.
            self._samples_missed = self.samples_sent - samples
            self.items_judged = items
            self._edges.clear()
        self._edges = deque(islice(self._edges, max(edges - self._edges_taken, 0), None))
        self._samples_taken, self._edges_taken, self._items_cut = samples, edges, items

    def judged(self) -> None:
        """Count a verdict."""
        self.items_judged += 1

    def may_send(self, event: Event, sample_rate: float) -> bool:
        """Return whether an event may be sent now."""
        if isinstance(event, SampleBlock):
            limit = min(self.max_duration * sample_rate, self.max_blocks * len(event.counts))
            if self._samples_on_their_way > limit:
                return False
            if self._items_cut - self.items_judged > self.max_items:
                return False
        return not self.awaits_edges(event, sample_rate)

    def awaits_edges(self, event: Event, sample_rate: float) -> bool:
        """Return whether an event must wait until the segmenter has taken earlier edges.

        A block must wait if its samples are so much later than an edge that the segmenter would
        ignore the edge. An edge must wait while the queue may be full.
        """
        if isinstance(event, SampleBlock):
            end = event.stamp + NANOSECONDS * len(event.counts) / sample_rate
            return bool(self._edges) and self._edges[0] < end - NANOSECONDS * self.max_duration
        return isinstance(event, EyeEdge) and len(self._edges) >= self.max_edges

    def give_up_edges(self) -> int:
        """Count the edges as lost if all samples have been taken; return their number."""
        lost = 0 if self._samples_on_their_way > 0 else len(self._edges)
        if lost:
            self._edges.clear()
        return lost

    @property
    def _samples_on_their_way(self) -> int:
        return self.samples_sent - self._samples_missed - self._samples_taken

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Due times of the events of a recording or a simulation, and flow control between nodes."""

from collections import deque
from dataclasses import dataclass, field
import threading

from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock


@dataclass
class Pacer:
    """Translate stamps into due times on another clock, at a rate in seconds of signal in a second.

    At rate 0 there is no pace at all. `start` is when the first event is due, in s; a block is due
    when its last sample has been taken.
    """

    rate: float
    sample_rate: float  # Hz
    start: float
    _first_stamp: int | None = field(default=None, init=False)

    def due(self, event: Event) -> float:
        """Return when an event is due, s."""
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
    """Limits of how far the line may lag behind the driver before the driver waits.

    The counts are those that the subscribers report, so that it holds for queues of any depth.
    Samples and edges are counted apart: they are topics of their own, and one may be held up while
    the other is not. For any thread.
    """

    max_duration: float = 1.0  # s of signal; below the lateness of edges the segmenter allows for
    max_blocks: int = 500  # below the depth of the queue, as max_edges
    max_edges: int = 500
    max_items: int = 100  # between segmenter and verdict

    def __post_init__(self) -> None:
        self._lock = threading.RLock()
        self.samples_sent = 0
        self.items_judged = 0
        self._edges: deque[int] = deque()  # stamps of those on their way
        self._samples_taken = self._edges_taken = self._items_cut = 0
        self._samples_missed = 0  # sent before there was this segmenter, which never saw them

    def sent(self, event: Event) -> None:
        """Note what is about to be sent."""
        with self._lock:
            if isinstance(event, SampleBlock):
                self.samples_sent += len(event.counts)
            elif isinstance(event, EyeEdge):
                self._edges.append(event.stamp)

    def taken(self, samples: int, edges: int, items: int) -> None:
        """Note what the segmenter says it has taken and cut in all."""
        with self._lock:
            if samples < self._samples_taken or edges < self._edges_taken:
                # A new segmenter has taken the place of one that was ended: it never saw the rest.
                self._samples_missed = self.samples_sent - samples
                self.items_judged = items
                self._edges.clear()
            for _ in range(min(edges - self._edges_taken, len(self._edges))):
                self._edges.popleft()
            self._samples_taken, self._edges_taken, self._items_cut = samples, edges, items

    def judged(self) -> None:
        """Count an item that has its verdict."""
        with self._lock:
            self.items_judged += 1

    def may_send(self, event: Event, sample_rate: float) -> bool:
        """Tell whether an event may follow now."""
        with self._lock:
            if isinstance(event, SampleBlock):
                limit = min(self.max_duration * sample_rate, self.max_blocks * len(event.counts))
                if self._samples_on_their_way > limit:
                    return False
                if self._items_cut - self.items_judged > self.max_items:
                    return False
            return not self.awaits_edges(event, sample_rate)

    def awaits_edges(self, event: Event, sample_rate: float) -> bool:
        """Tell whether an event must wait for edges that were sent before it.

        With a block the segmenter would have samples so much later than an edge that it gives the
        edge up. An edge may find the queue full.
        """
        with self._lock:
            if isinstance(event, SampleBlock):
                end = event.stamp + NANOSECONDS * len(event.counts) / sample_rate
                return bool(self._edges) and self._edges[0] < end - NANOSECONDS * self.max_duration
            return isinstance(event, EyeEdge) and len(self._edges) >= self.max_edges

    def give_up_edges(self) -> int:
        """Wait no longer for edges if they alone are missing; return how many those are."""
        with self._lock:
            if self._samples_on_their_way > 0:
                return 0
            lost = len(self._edges)
            self._edges.clear()
            return lost

    @property
    def _samples_on_their_way(self) -> int:
        return self.samples_sent - self._samples_missed - self._samples_taken

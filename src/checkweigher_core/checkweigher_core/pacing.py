# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pacing of the playback of a recording or a simulation: due times of events, and flow control."""

from collections import deque
from dataclasses import dataclass, field
from itertools import islice

from checkweigher_core.recording import Event
from checkweigher_core.records import NANOSECONDS, EyeEdge, SampleBlock


@dataclass
class Pacer:
    """Due times of the events of a recording or a simulation.

    A block is due at the time of its end, any other event at its stamp. If `rate` is 0, all events
    are due at `start`.
    """

    rate: float  # playback speed in seconds of signal per second
    sample_rate: float  # sample rate in Hz
    start: float  # due time in s of the stamp of the first event
    _first_stamp: int | None = field(default=None, init=False)

    def due(self, event: Event) -> float:
        """Return the due time of an event in s, on the clock of `start`."""
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
    """Flow control of the driver, which waits while the other nodes lag too far behind.

    The lag is computed from the numbers of samples, edges and items that the segmenter has
    processed according to its reports, so it does not depend on the depth of the DDS queues.
    Samples and edges are counted separately, because DDS may delay one topic more than the other.
    The methods are not thread-safe.
    """

    # Largest lag in s of signal. The lag must be less than the parameter `edge_lateness` of the
    # segmenter, because the segmenter discards later edges.
    max_duration: float = 1.0
    max_blocks: int = 500  # largest lag in blocks, below the depth of the DDS queue
    max_edges: int = 500  # largest lag in edges, below the depth of the DDS queue
    max_items: int = 100  # largest number of items with a weigh window but without a verdict

    def __post_init__(self) -> None:
        self.samples_sent = 0
        self.items_judged = 0  # number of items with a verdict
        self._edges: deque[int] = deque()  # stamps of edges that are not processed yet
        self._samples_taken = self._edges_taken = self._items_cut = 0
        self._samples_missed = 0  # number of sent samples that a restarted segmenter has missed

    def sent(self, event: Event) -> None:
        """Count an event that is about to be sent. Reference masses are not counted."""
        if isinstance(event, SampleBlock):
            self.samples_sent += len(event.counts)
        elif isinstance(event, EyeEdge):
            self._edges.append(event.stamp)

    def taken(self, samples: int, edges: int, items: int) -> None:
        """Update the numbers of samples, edges and items that the segmenter has processed.

        If the number of samples or edges is less than before, the segmenter was restarted. Events
        that were sent before a restart are no longer awaited.
        """
        if samples < self._samples_taken or edges < self._edges_taken:
            # Do not wait for the earlier events, because the segmenter was restarted and did not
            # receive them.
            self._samples_missed = self.samples_sent - samples
            self.items_judged = items
            self._edges.clear()
        self._edges = deque(islice(self._edges, max(edges - self._edges_taken, 0), None))
        self._samples_taken, self._edges_taken, self._items_cut = samples, edges, items

    def may_send(self, event: Event, sample_rate: float) -> bool:
        """Return whether an event may be sent now.

        A block must wait while too many samples are not processed yet, or too many items have no
        verdict yet. A block or an edge must also wait for earlier edges (see `awaits_edges`). A
        reference mass never waits.
        """
        if isinstance(event, SampleBlock):
            limit = min(self.max_duration * sample_rate, self.max_blocks * len(event.counts))
            if self._samples_on_their_way > limit:
                return False
            if self._items_cut - self.items_judged > self.max_items:
                return False
        return not self.awaits_edges(event, sample_rate)

    def awaits_edges(self, event: Event, sample_rate: float) -> bool:
        """Return whether an event must wait until the segmenter has processed earlier edges.

        A block must wait if it ends so long after an edge that the segmenter might discard the
        edge. An edge must wait while the DDS queue of edges may be full.
        """
        if isinstance(event, SampleBlock):
            end = event.stamp + NANOSECONDS * len(event.counts) / sample_rate
            return bool(self._edges) and self._edges[0] < end - NANOSECONDS * self.max_duration
        return isinstance(event, EyeEdge) and len(self._edges) >= self.max_edges

    def give_up_edges(self) -> int:
        """Forget the edges that are not processed yet. Returns the number of forgotten edges.

        Edges are forgotten only if the segmenter has processed all samples; otherwise the result is
        0. An edge that is not processed by then has not reached the segmenter, so the driver would
        wait for the edge forever.
        """
        lost = 0 if self._samples_on_their_way > 0 else len(self._edges)
        if lost:
            self._edges.clear()
        return lost

    @property
    def _samples_on_their_way(self) -> int:
        return self.samples_sent - self._samples_missed - self._samples_taken

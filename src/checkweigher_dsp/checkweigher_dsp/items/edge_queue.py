# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eye edges on their way to the stage, in the order of their stamps."""

from bisect import insort
from collections.abc import Callable, Iterable
from itertools import takewhile
from operator import attrgetter

from checkweigher_core.records import EyeEdge

_STAMP = attrgetter('stamp')


class EdgeQueue:
    """Keep edges until the samples have reached them.

    Meanwhile they are put into order, and no window is later for it, since it needs the samples up
    to t3 anyway. An edge that is far behind another one is kept apart until the next samples come:
    these may show that the clock has gone back, and the edge is no late one then. An edge may be
    `lateness`, ns, behind others.
    """

    def __init__(self, lateness: int) -> None:
        self._lateness = lateness
        self._edges: list[EyeEdge] = []
        self._strays: list[EyeEdge] = []
        self._newest: int | None = None  # stamp of an edge by this clock

    @property
    def is_empty(self) -> bool:
        """Whether no edge waits, but for those that are kept apart."""
        return not self._edges

    def add(self, edge: EyeEdge) -> None:
        """Add an edge."""
        if self._newest is not None and edge.stamp < self._newest - self._lateness:
            self._strays.append(edge)
            return
        if self._newest is None or edge.stamp > self._newest:
            self._newest = edge.stamp
        insort(self._edges, edge, key=_STAMP)

    def put_back(self, edges: Iterable[EyeEdge]) -> None:
        """Take edges as edges of the present clock."""
        self._edges = sorted([*edges, *self._edges], key=_STAMP)
        if self._edges:
            newest = self._edges[-1].stamp
            self._newest = newest if self._newest is None else max(self._newest, newest)

    def admit_strays(self) -> None:
        """Take what was kept apart: the clock has not gone back, the edges are late."""
        if self._strays:  # with each block of samples, and there hardly ever are any
            strays, self._strays = self._strays, []
            self.put_back(strays)

    def pop_while(self, condition: Callable[[EyeEdge], bool]) -> list[EyeEdge]:
        """Return the first edges, as long as they meet a condition."""
        popped = list(takewhile(condition, self._edges))
        del self._edges[: len(popped)]
        return popped

    def drop_after(self, stamp: int) -> None:
        """Forget edges later than a time, ns: no sample will reach them soon enough."""
        if self._newest is not None and self._newest > stamp:
            self._edges = [edge for edge in self._edges if edge.stamp <= stamp]
            self._newest = self._edges[-1].stamp if self._edges else None

    def pop_all(self) -> list[EyeEdge]:
        """Return all edges."""
        self.admit_strays()
        self._newest = None
        return self.pop_while(lambda edge: True)

    def pop_of_new_clock(self, stamp: int, *, forward: bool) -> list[EyeEdge]:
        """Return the edges that are of a clock which jumps to `stamp`, forward or back."""
        if forward:
            new = [edge for edge in self._edges if edge.stamp >= stamp]
            self._edges = self._edges[: len(self._edges) - len(new)]
            return new
        new, self._strays = self._strays, []
        return new

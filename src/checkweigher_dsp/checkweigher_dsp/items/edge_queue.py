# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Queue of the photo-eye edges in the order of their time stamps."""

from bisect import bisect_left, insort
from collections.abc import Callable, Iterable
from itertools import takewhile
import math
from operator import attrgetter

from checkweigher_core.records import EyeEdge

_STAMP = attrgetter('stamp')


class EdgeQueue:
    """Edges that wait for the samples of the same time, sorted by time stamp.

    The queue does not delay a window, because a window needs all samples up to its last edge
    anyway. An edge whose stamp is more than `lateness`, in ns, before the newest stamp is a stray.
    A stray waits for the next samples, which show whether the edge is late or the clock has gone
    back.
    """

    def __init__(self, lateness: int) -> None:
        self._lateness = lateness
        self._edges: list[EyeEdge] = []
        self._strays: list[EyeEdge] = []
        # Largest stamp in ns of the edges since the clock last changed, or -inf without edges.
        self._newest = -math.inf

    @property
    def is_empty(self) -> bool:
        """Whether no edge waits, apart from strays."""
        return not self._edges

    def add(self, edge: EyeEdge) -> None:
        """Add an edge, as a stray if its stamp is more than `lateness` before the newest stamp."""
        if edge.stamp < self._newest - self._lateness:
            self._strays.append(edge)
        else:
            self._newest = max(self._newest, edge.stamp)
            insort(self._edges, edge, key=_STAMP)

    def put_back(self, edges: Iterable[EyeEdge]) -> None:
        """Add edges without checking whether they are strays."""
        self._edges = sorted([*edges, *self._edges], key=_STAMP)
        self._newest = max([self._newest, *(edge.stamp for edge in self._edges[-1:])])

    def admit_strays(self) -> None:
        """Add the strays as late edges, because the clock has not gone back."""
        strays, self._strays = self._strays, []
        self.put_back(strays)

    def pop_while(self, condition: Callable[[EyeEdge], bool]) -> list[EyeEdge]:
        """Remove and return the edges before the first edge that does not meet a condition."""
        popped = list(takewhile(condition, self._edges))
        del self._edges[: len(popped)]
        return popped

    def drop_after(self, stamp: int) -> None:
        """Remove the edges after a time in ns, but keep all strays."""
        if self._newest > stamp:
            self._edges = [edge for edge in self._edges if edge.stamp <= stamp]
            self._newest = self._edges[-1].stamp if self._edges else -math.inf

    def pop_all(self) -> list[EyeEdge]:
        """Remove and return all edges, including strays."""
        self.admit_strays()
        self._newest = -math.inf
        return self.pop_while(lambda edge: True)

    def pop_of_new_clock(self, stamp: int, *, forward: bool) -> list[EyeEdge]:
        """Remove and return the edges after a jump of the clock to `stamp` in ns.

        If the clock has jumped `forward`, the edges from `stamp` on are returned, otherwise the
        strays.
        """
        if forward:
            position = bisect_left(self._edges, stamp, key=_STAMP)
            new, self._edges = self._edges[position:], self._edges[:position]
        else:
            new, self._strays = self._strays, []
        return new

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The time by which each product that leaves the weigh belt must have its verdict."""

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, Verdict
from checkweigher_dsp.rejection.outfeed_watch import FLICKER

# Until a first product has shown how long it takes to the rejector.
_FIRST_TIMEOUT = NANOSECONDS


class VerdictWatch:
    """Notice that a verdict is overdue: the node that gives verdicts hangs.

    All times are in ns. Those of the edges are their stamps; `now` is on any clock that never
    steps back. From a product at the outfeed eye to the next verdict there is `timeout` at most; 0
    for as long as the product before took from the outfeed eye to the moment at which the rejector
    had to be told.
    """

    def __init__(self, timeout: int) -> None:
        self._timeout = timeout
        self._travel = _FIRST_TIMEOUT
        self._infeed_blocked: int | None = None
        self._outfeed_clear: int | None = None
        self._length = 0  # for which the last product blocked the infeed eye
        self._last: int | None = None  # stamp of the last product at the outfeed eye
        self._since: int | None = None  # when the first product without a verdict was there

    @property
    def timeout(self) -> int:
        """The time that is allowed now."""
        return self._timeout or self._travel

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Take an edge of the photo-eyes."""
        if edge.eye == Eye.INFEED and edge.blocked:
            self._infeed_blocked = edge.stamp
        elif edge.eye == Eye.INFEED:
            if self._infeed_blocked is not None:
                self._length = max(edge.stamp - self._infeed_blocked, 0)
        elif not edge.blocked:
            self._outfeed_clear = edge.stamp
        elif self._is_product(edge.stamp):
            self._last = edge.stamp
            if self._since is None:
                self._since = now

    def _is_product(self, stamp: int) -> bool:
        """Tell whether the outfeed eye sees another product, and no hole or flicker of the last."""
        if self._last is None or stamp < self._last:
            return True
        within = stamp - self._last < self._length
        clear = self._outfeed_clear
        return not within and (clear is None or not 0 <= stamp - clear < FLICKER)

    def verdict(self, verdict: Verdict) -> None:
        """Take a verdict, which shows that verdicts come."""
        self._since = None
        if verdict.t3 is not None and verdict.reject_at is not None:
            self._travel = max(verdict.reject_at - verdict.t3, 0) or self._travel

    def clear(self) -> None:
        """Wait for no verdict any more."""
        self._since = None

    def is_overdue(self, now: int) -> bool:
        """Tell, once for a product, whether its verdict is overdue."""
        if self._since is None or now - self._since <= self.timeout:
            return False
        self._since = None
        return True

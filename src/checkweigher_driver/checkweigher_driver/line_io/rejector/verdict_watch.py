# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Deadline of the verdict on each product that leaves the weigh belt."""

import math

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, Verdict
from checkweigher_dsp.rejection.outfeed_watch import FLICKER

# Before the first product with a reject time.
_FIRST_TIMEOUT = NANOSECONDS


class VerdictWatch:
    """Watch for an overdue verdict, which shows that the node of the verdicts hangs.

    All times are in ns. Edges have stamps; `now` is on any clock that never steps back. `timeout`
    is the longest time from a product at the outfeed eye to the next verdict. If it is 0, the limit
    is the time of the previous product from the outfeed eye to its reject time.
    """

    def __init__(self, timeout: int) -> None:
        self._timeout = timeout
        self._travel = _FIRST_TIMEOUT
        self._infeed_blocked = math.inf
        self._outfeed_clear = -math.inf
        self._length = 0.0  # time for which the last product blocked the infeed eye
        self._last = -math.inf  # stamp of the last product at the outfeed eye
        self._since: int | None = None  # when the first product without a verdict came

    @property
    def timeout(self) -> int:
        """Longest time to a verdict at present, ns."""
        return self._timeout or self._travel

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Process an edge of the photo-eyes."""
        if edge.eye == Eye.INFEED and edge.blocked:
            self._infeed_blocked = edge.stamp
        elif edge.eye == Eye.INFEED:
            self._length = max(edge.stamp - self._infeed_blocked, 0)
        elif not edge.blocked:
            self._outfeed_clear = edge.stamp
        elif self._is_product(edge.stamp):
            self._last = edge.stamp
            if self._since is None:
                self._since = now

    def _is_product(self, stamp: int) -> bool:
        """Return whether the outfeed eye sees a new product, not a hole or flicker of the last."""
        if stamp < self._last:
            return True
        return stamp - self._last >= self._length and not 0 <= stamp - self._outfeed_clear < FLICKER

    def verdict(self, verdict: Verdict) -> None:
        """Process a verdict, which shows that its node works."""
        self._since = None
        if verdict.t3 is not None and verdict.reject_at is not None:
            self._travel = max(verdict.reject_at - verdict.t3, 0) or self._travel

    def clear(self) -> None:
        """Stop waiting for a verdict."""
        self._since = None

    def is_overdue(self, now: int) -> bool:
        """Return whether a verdict is overdue, once for each product."""
        if self._since is None or now - self._since <= self.timeout:
            return False
        self._since = None
        return True

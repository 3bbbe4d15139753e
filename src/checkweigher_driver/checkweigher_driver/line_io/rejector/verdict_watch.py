# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Monitor of the time from a product at the outfeed eye to the next verdict."""

import math

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, Verdict
from checkweigher_dsp.rejection.outfeed_watch import FLICKER

_FIRST_TIMEOUT = NANOSECONDS  # longest wait in ns until the first verdict with a reject time


class VerdictWatch:
    """Monitor for overdue verdicts, which show that the node reject hangs.

    All times are in ns; `now` is on a monotonic clock. `timeout` is the longest time from a product
    at the outfeed eye to the next verdict. If `timeout` is 0, the limit is the travel time of the
    previous product from the outfeed eye to the rejector. Before the first verdict with a reject
    time, the limit is 1 s if `timeout` is 0.
    """

    def __init__(self, timeout: int) -> None:
        self._timeout = timeout
        self._travel = _FIRST_TIMEOUT
        self._infeed_blocked = math.inf
        self._outfeed_clear = -math.inf
        self._length = 0.0  # time in ns for which the last product blocked the infeed eye
        self._last = -math.inf  # stamp of the last product at the outfeed eye
        self._since: int | None = None  # time in ns since which a verdict is awaited

    @property
    def timeout(self) -> int:
        """Present limit in ns of the time from a product at the outfeed eye to the next verdict."""
        return self._timeout or self._travel

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Begin to wait for a verdict if an edge shows a new product at the outfeed eye."""
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
        """Return whether an edge belongs to a new product, not to a hole in the last product."""
        if stamp < self._last:
            return True
        return stamp - self._last >= self._length and not 0 <= stamp - self._outfeed_clear < FLICKER

    def verdict(self, verdict: Verdict) -> None:
        """Stop waiting for the verdicts on all products so far, and update the travel time."""
        self._since = None
        if verdict.t3 is not None and verdict.reject_at is not None:
            self._travel = max(verdict.reject_at - verdict.t3, 0) or self._travel

    def clear(self) -> None:
        """Stop waiting for a verdict."""
        self._since = None

    def is_overdue(self, now: int) -> bool:
        """Return whether a verdict is overdue. True is returned only once for each deadline."""
        if self._since is None or now - self._since <= self.timeout:
            return False
        self._since = None
        return True

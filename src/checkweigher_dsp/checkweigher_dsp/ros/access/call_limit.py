# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rate limit for the calls of a service, so that a flood costs the line little."""

RATE = 10.0  # calls a second in the long run
BURST = 50  # calls at once


class CallLimit:
    """A token bucket of `burst` calls, refilled at `rate`/s."""

    def __init__(self, rate: float = RATE, burst: int = BURST) -> None:
        self._rate, self._burst = rate, burst
        self._left = float(burst)
        self._last: float | None = None

    def take(self, now: float) -> bool:
        """Return whether a call at `now`, s of the monotonic clock, may be served."""
        elapsed = 0.0 if self._last is None else max(now - self._last, 0.0)
        self._last = now
        self._left = min(self._left + elapsed * self._rate, self._burst)
        if self._left < 1:
            return False
        self._left -= 1
        return True

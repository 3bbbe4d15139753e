# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Offset from stamps, on a clock that can be set, to a clock that never steps."""

from collections.abc import Callable
import math
import time

from checkweigher_core.records import NANOSECONDS

_DOUBT = 10 * NANOSECONDS  # after a step, because a stamp may be from before or after it
_TRIES = 5


def read_clocks() -> tuple[int, int]:
    """Return the times of the monotonic and the real-time clock at one moment, ns.

    They are read several times, and the readings that lie closest together are returned. Otherwise
    a thread that is suspended between two readings would see a step.
    """

    def reading() -> tuple[int, int, int]:
        before, real, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        return after - before, (before + after) // 2, real

    _, monotonic, real = min(reading() for _ in range(_TRIES))
    return monotonic, real


class ClockStepWatch:
    """Offset between the two clocks, unknown for a while after a step.

    A change of the offset by more than `tolerance`, ns, between two calls of `look` is a step.
    """

    def __init__(self, tolerance: int, clocks: Callable[[], tuple[int, int]] = read_clocks) -> None:
        self._tolerance = tolerance
        self._clocks = clocks
        monotonic, real = clocks()
        self._offset = monotonic - real
        self._stepped_at = -math.inf
        self.steps = 0

    def look(self) -> int | None:
        """Return monotonic minus real time in ns, or None shortly after a step.

        Call it often, because a step back and forth between two calls is not detected.
        """
        monotonic, real = self._clocks()
        offset, before = monotonic - real, self._offset
        self._offset = offset
        if abs(offset - before) > self._tolerance:
            self._stepped_at = monotonic
            self.steps += 1
        return None if monotonic - self._stepped_at < _DOUBT else offset

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Offset between the real-time clock, which can be set, and the monotonic clock."""

from collections.abc import Callable
import math
import time

from checkweigher_core.records import NANOSECONDS

# Time in ns for which stamps from before a step of the real-time clock may arrive after the step.
_DOUBT = 10 * NANOSECONDS
_TRIES = 5


def read_clocks() -> tuple[int, int]:
    """Return nearly simultaneous readings in ns of the monotonic and the real-time clock.

    The clocks are read several times. The two readings that are closest together are returned,
    because the thread may be suspended between two readings.
    """

    def reading() -> tuple[int, int, int]:
        before, real, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        return after - before, (before + after) // 2, real

    _, monotonic, real = min(reading() for _ in range(_TRIES))
    return monotonic, real


class ClockStepWatch:
    """Detector of steps of the real-time clock.

    A step is a change of the offset between the clocks by more than `tolerance` in ns between two
    calls of `look`.
    """

    def __init__(self, tolerance: int, clocks: Callable[[], tuple[int, int]] = read_clocks) -> None:
        self._tolerance = tolerance
        self._clocks = clocks
        monotonic, real = clocks()
        self._offset = monotonic - real
        self._stepped_at = -math.inf
        self.steps = 0

    def look(self) -> int | None:
        """Return monotonic time minus real time in ns, or None in the first 10 s after a step.

        The method must be called often, because two opposite steps between two calls are not
        detected.
        """
        monotonic, real = self._clocks()
        offset, before = monotonic - real, self._offset
        self._offset = offset
        if abs(offset - before) > self._tolerance:
            self._stepped_at = monotonic
            self.steps += 1
        return None if monotonic - self._stepped_at < _DOUBT else offset

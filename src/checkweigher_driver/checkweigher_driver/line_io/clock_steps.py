# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The offset from stamps, on a clock that can be set, to a clock that never steps."""

from collections.abc import Callable
import time

from checkweigher_core.records import NANOSECONDS

# After a step, for which a stamp may be from before or after it.
_DOUBT = 10 * NANOSECONDS

_NEAR = 50_000  # ns, between two readings that belong together
_TRIES = 20


def read_clocks() -> tuple[int, int]:
    """Return the times of the monotonic and the real-time clock at one moment, ns.

    A thread that is suspended between the two readings would make a step of it. So they are read
    until they lie close together, and the closest ones are taken.
    """
    found, nearest = (0, 0), None
    for _ in range(_TRIES):
        before, real, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if nearest is None or after - before < nearest:
            nearest, found = after - before, ((before + after) // 2, real)
        if nearest < _NEAR:
            break
    return found


class ClockStepWatch:
    """The offset between the two clocks, and whether a step has put it in doubt.

    A change of the offset by more than `tolerance`, ns, from one look to the next is a step.
    """

    def __init__(self, tolerance: int, clocks: Callable[[], tuple[int, int]] = read_clocks) -> None:
        self._tolerance = tolerance
        self._clocks = clocks
        monotonic, real = clocks()
        self._offset = monotonic - real
        self._stepped_at: int | None = None
        self.steps = 0

    def look(self) -> int | None:
        """Return monotonic time less stamp, ns, or None while a step leaves that in doubt.

        Call it often: a step back and forth between two looks is not noticed.
        """
        monotonic, real = self._clocks()
        offset, before = monotonic - real, self._offset
        self._offset = offset
        if abs(offset - before) > self._tolerance:
            self._stepped_at = monotonic
            self.steps += 1
        if self._stepped_at is not None and monotonic - self._stepped_at < _DOUBT:
            return None
        return offset

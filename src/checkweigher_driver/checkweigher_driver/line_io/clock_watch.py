"""Stamps are on a clock that can be set; what is due has to be on one that cannot."""

from collections.abc import Callable
import time

from checkweigher_dsp.records import NANOSECONDS

# For which nobody knows whether a stamp is from before or after a step.
_DOUBT = 10 * NANOSECONDS

_NEAR = 50_000  # ns, between two readings that belong together
_TRIES = 20


def read_clocks() -> tuple[int, int]:
    """Return the times of the monotonic and the real-time clock at one moment, ns.

    A thread that is put aside between the two readings would make a step of it: they are read again
    then, and the closest ones are taken.
    """
    found = (0, 0)
    nearest = None
    for _ in range(_TRIES):
        before, real, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if nearest is None or after - before < nearest:
            nearest, found = after - before, ((before + after) // 2, real)
        if nearest < _NEAR:
            break
    return found


class ClockWatch:
    """Compare the real-time clock with the monotonic one.

    Parameters
    ----------
    tolerance : int
        ns; what changes by more from one look to the next was a step.
    clocks : callable
        Gives the times of the monotonic and the real-time clock, ns.

    Attributes
    ----------
    steps : int
        How often the real-time clock was set.
    """

    def __init__(
        self,
        tolerance: int,
        clocks: Callable[[], tuple[int, int]] = read_clocks,
    ) -> None:
        self._tolerance = tolerance
        self._clocks = clocks
        monotonic, real = clocks()
        self._offset = monotonic - real
        self._stepped_at: int | None = None
        self.steps = 0

    def look(self) -> int | None:
        """Return what makes monotonic times of stamps, ns, None while that is in doubt.

        To be called often: a step is noticed, but not one back and forth between two looks.
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

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clock of the deadlines, and a timer for the next one."""

from collections.abc import Callable
import time

from checkweigher_core.ros.port_node import PortNode
from checkweigher_dsp.rejection.timing import StreamClock


class DeadlineTimer:
    """Clocks of arrivals and stamps in ns, and a timer for the next deadline.

    Attributes
    ----------
    clock : StreamClock
        Clock of the stamps. If it is not running, nothing becomes overdue on the clock of arrivals.
    """

    def __init__(self, node: PortNode, callback: Callable[[], None], *, running: bool) -> None:
        self.clock = StreamClock(running=running)
        self._timer = node.create_one_shot_timer(callback)

    @property
    def now(self) -> int | None:
        """Time on the clock of arrivals in ns; None if nothing can be overdue."""
        return time.monotonic_ns() if self.clock.running else None

    @property
    def stamp(self) -> int | None:
        """Time on the clock of stamps in ns; None before the first message."""
        return self.clock.at(time.monotonic_ns())

    def saw(self, stamp: int) -> None:
        """Set the clock of the stamps by a message that has just come."""
        self.clock.saw(stamp, time.monotonic_ns())

    def set(self, due: int | None, stamp: int | None) -> None:
        """Set the timer to a time of arrivals, to a stamp, or (both None) to nothing."""
        times = [due if self.clock.running else None]
        if stamp is not None:
            times.append(self.clock.reaches(stamp, time.monotonic_ns()))
        if known := [each for each in times if each is not None]:
            self._timer.set_by(min(known))
        else:
            self._timer.clear()

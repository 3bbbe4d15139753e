# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clocks and timer for the deadlines of the verdicts."""

from collections.abc import Callable
import time

from checkweigher_core.ros.port_node import PortNode
from checkweigher_dsp.rejection.timing import StreamClock


class DeadlineTimer:
    """Timer for the next deadline, with a clock of arrivals and a clock of stamps, both in ns.

    The clock of arrivals is the monotonic clock of the computer. The clock of stamps shows the time
    in the stamps of the messages. If the clock of stamps is not `running`, it stands still between
    two messages, and no verdict becomes overdue.
    """

    def __init__(self, node: PortNode, callback: Callable[[], None], *, running: bool) -> None:
        self.clock = StreamClock(running=running)
        self._timer = node.create_one_shot_timer(callback)

    @property
    def now(self) -> int | None:
        """Time on the clock of arrivals in ns, or None if no verdict can become overdue."""
        return time.monotonic_ns() if self.clock.running else None

    @property
    def stamp(self) -> int | None:
        """Time on the clock of stamps in ns, or None before the first message."""
        return self.clock.at(time.monotonic_ns())

    def saw(self, stamp: int) -> None:
        """Set the clock of stamps by the stamp of a message that has just arrived."""
        self.clock.saw(stamp, time.monotonic_ns())

    def set(self, due: int | None, stamp: int | None) -> None:
        """Set the timer to the earlier of two times, unless the timer is set to an earlier time.

        If neither time is known, the timer is cleared. `due` is a time on the clock of arrivals,
        and `stamp` a time on the clock of stamps. If the clock of stamps is not running, `due` and
        a future `stamp` count as unknown.
        """
        times = [due if self.clock.running else None]
        if stamp is not None:
            times.append(self.clock.reaches(stamp, time.monotonic_ns()))
        if known := [each for each in times if each is not None]:
            self._timer.set_by(min(known))
        else:
            self._timer.clear()

"""A timer that any callback of the process may set."""

from collections.abc import Callable
import time

from rclpy.node import Node

from checkweigher_dsp.ros.delivery import current

_SHORTEST = 1000  # ns


class Alarm:
    """Call something once, when its time has come.

    Messages that are handed over come in the thread of whoever published them, and there a timer
    of rclpy must not be cancelled: its executor may just be about to call it, and then raises.
    Here it rings for nothing. And the executor hears of a new time when it already waits.

    Parameters
    ----------
    node : Node
        Whose executor calls.
    callback : callable
        What is called.
    """

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._delivery = current()
        self._due: int | None = None
        self._set_to: int | None = None  # when the timer runs out
        self._timer = node.create_timer(1.0, self._ring)
        self._timer.cancel()

    def set(self, due: int) -> None:
        """Ring at a time, ns of the monotonic clock, and no more at the one set before."""
        self._due = due
        if self._set_to is None or due < self._set_to:
            self._set_to = due
            self._timer.timer_period_ns = max(due - time.monotonic_ns(), _SHORTEST)
            self._timer.reset()
            if self._delivery is not None:
                self._delivery.nudge()

    def set_by(self, due: int) -> None:
        """Ring at a time or at the one set before, whichever is sooner."""
        self.set(due if self._due is None else min(due, self._due))

    def clear(self) -> None:
        """Do not ring."""
        self._due = None

    def _ring(self) -> None:
        self._timer.cancel()
        self._set_to = None
        due, self._due = self._due, None
        if due is None:
            return
        if due > time.monotonic_ns():
            self.set(due)
        else:
            self._callback()

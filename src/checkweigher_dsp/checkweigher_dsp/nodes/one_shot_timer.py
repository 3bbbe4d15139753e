# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A timer that rings once, and may be set from any thread."""

from collections.abc import Callable
import time

from rclpy.node import Node

_SHORTEST = 1000  # ns


class OneShotTimer:
    """Call something once, when its time has come.

    A timer of rclpy must not be cancelled in another thread than that of its executor, which may
    be about to call it and then raises: this one rings for nothing instead.
    """

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._node = node
        self._callback = callback
        self._due: int | None = None
        self._set_to: int | None = None  # when the timer of rclpy runs out
        self._timer = node.create_timer(1.0, self._ring, autostart=False)

    def set(self, due: int) -> None:
        """Ring at a time, ns of the monotonic clock, and no more at the one set before."""
        self._due = due
        if self._set_to is None or due < self._set_to:
            self._set_to = due
            self._timer.timer_period_ns = max(due - time.monotonic_ns(), _SHORTEST)
            self._timer.reset()
            if self._node.executor is not None:
                self._node.executor.wake()  # it may wait for a later time

    def set_by(self, due: int) -> None:
        """Ring at a time or at the one set before, the sooner of both."""
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

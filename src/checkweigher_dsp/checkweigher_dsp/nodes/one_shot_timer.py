# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A timer that fires once, and may be set from any thread."""

from collections.abc import Callable
import time

from rclpy.node import Node

_SHORTEST = 1000  # ns


class OneShotTimer:
    """Timer that calls a function once, at a time of the monotonic clock in ns.

    A timer of rclpy must be cancelled in the thread of its executor. In another thread the executor
    may be about to call it, and would raise. This timer therefore fires without effect if it was
    cleared.
    """

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._node = node
        self._callback = callback
        self._due: int | None = None
        self._set_to: int | None = None  # time at which the timer of rclpy fires
        self._timer = node.create_timer(1.0, self._ring, autostart=False)

    def set(self, due: int) -> None:
        """Set the time, in place of the one set before."""
        self._due = due
        if self._set_to is None or due < self._set_to:
            self._set_to = due
            self._timer.timer_period_ns = max(due - time.monotonic_ns(), _SHORTEST)
            self._timer.reset()
            if self._node.executor is not None:
                self._node.executor.wake()  # it may wait for a later time

    def set_by(self, due: int) -> None:
        """Set the time, unless an earlier one is set."""
        self.set(due if self._due is None else min(due, self._due))

    def clear(self) -> None:
        """Clear the time."""
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

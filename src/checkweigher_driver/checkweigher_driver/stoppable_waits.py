# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Waits of one thread, for a time or for a condition, until the thread is told to stop."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
import threading
import time
from typing import Any

_PERIOD = 0.02  # s: some changes are not told of
_REMINDER = 5.0  # s


class StoppableWaits:
    """Waits that end as soon as they need not go on, or once `stopping` is set.

    A lock that is given is held while a condition is looked at or changed, and free during a wait.
    """

    def __init__(self, lock: Any = None) -> None:
        self.stopping = False
        self._changed = threading.Condition(lock)

    @contextmanager
    def change(self) -> Iterator[None]:
        """Change a condition while no wait looks at it."""
        with self._changed:
            yield
            self._changed.notify_all()

    def until(self, due: float) -> bool:
        """Wait until a time of the monotonic clock, s; return whether to go on."""
        with self._changed:
            while not self.stopping and (remaining := due - time.monotonic()) > 0:
                self._changed.wait(timeout=remaining)
            return not self.stopping

    def for_end(self, condition: Callable[[], bool], patience: float) -> bool:
        """Wait until a condition holds or `patience` s are over, even if told to stop."""
        with self._changed:
            return self._changed.wait_for(condition, patience)

    def for_condition(
        self,
        condition: Callable[[], bool],
        patience: float = math.inf,
        meanwhile: Callable[[float], None] | None = None,
        remind: Callable[[], None] | None = None,
    ) -> bool:
        """Wait until a condition holds or `patience` s are over; return whether to go on.

        The condition is looked at after each change, and every 20 ms. Before each wait `meanwhile`
        is called with the s waited so far, while nothing is locked; `remind` is called each 5 s.
        """
        began = reminded = time.monotonic()
        while not self._is_over(condition):
            now = time.monotonic()
            if now - began > patience:
                break
            if meanwhile is not None:
                meanwhile(now - began)
            if remind is not None and now - reminded > _REMINDER:
                reminded = now
                remind()
            with self._changed:
                if not self._is_over(condition):
                    self._changed.wait(timeout=_PERIOD)
        return not self.stopping

    def _is_over(self, condition: Callable[[], bool]) -> bool:
        with self._changed:
            return self.stopping or condition()

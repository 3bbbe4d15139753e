# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""One-shot timer that does not wake the executor."""

from collections.abc import Callable
import math
import threading
import time

from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros.outputs import LOCK


class OneShotTimer:
    """Timer that calls a function once at a given time in ns on the monotonic clock.

    All timers of a process share one thread of their own, because each wake of an rclpy executor
    takes 1 ms or more. The thread holds the lock of the process while it calls the function. A
    caller of `set`, `set_by` or `clear` must also hold the lock, so that a timer does not fire
    after it was cleared.

    Parameters
    ----------
    callback : callable
        Function to call.
    fail : callable
        Function to call with an exception of `callback`.
    """

    def __init__(self, callback: Callable[[], object], fail: Callable[[Exception], None]) -> None:
        self.due: int | None = None  # time in ns at which the timer fires, None if it is not set
        self._callback = callback
        self._fail = fail

    def set(self, due: int) -> None:
        """Set the time in ns on the monotonic clock at which the timer fires."""
        self.due = due
        _thread.serve(self, due)

    def set_by(self, due: int) -> None:
        """Set the time in ns at which the timer fires, unless an earlier time is set."""
        if self.due is None or due < self.due:
            self.set(due)

    def clear(self) -> None:
        """Stop the timer, so that it does not fire."""
        self.due = None

    def fire(self) -> None:
        """Call the function if the timer is set and due, and pass its exception to `fail`."""
        with LOCK:
            if self.due is None or self.due > time.monotonic_ns():
                return
            self.due = None
            try:
                self._callback()
            except Exception as error:
                self._fail(error)


class _TimerThread:
    """Thread that fires the timers of a process. The thread starts with the first timer."""

    def __init__(self) -> None:
        self._timers: set[OneShotTimer] = set()
        self._wakes: float = 0  # time in ns at which the present wait ends
        self._set = threading.Condition()
        self._thread: threading.Thread | None = None

    def serve(self, timer: OneShotTimer, due: int) -> None:
        """Add a timer that fires at time `due` in ns."""
        with self._set:
            self._timers.add(timer)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name='timers', daemon=True)
                self._thread.start()
            if due < self._wakes:
                self._set.notify()

    def _run(self) -> None:
        while True:
            for timer in self._wait():
                timer.fire()

    def _wait(self) -> list[OneShotTimer]:
        """Wait until a timer is due, and return all timers that are due."""
        with self._set:
            while True:
                times = {each: due for each in self._timers if (due := each.due) is not None}
                self._timers = set(times)  # drop timers that were cleared or have fired
                now, self._wakes = time.monotonic_ns(), min(times.values(), default=math.inf)
                if self._wakes <= now:
                    return [each for each, due in times.items() if due <= now]
                self._set.wait((self._wakes - now) / NANOSECONDS if times else None)


_thread = _TimerThread()

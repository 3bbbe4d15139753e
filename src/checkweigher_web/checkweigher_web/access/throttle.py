# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Failed logins: each account and each address has to wait longer after each one."""

from collections.abc import Callable
import time

_FREE = 3  # failures without a wait: a person mistypes
_LONGEST = 300.0  # s
_FORGOTTEN = 3600.0  # s after the last failure


class Throttle:
    """Waits after failures, which double: 1 s after the third in a row, 5 min at most.

    A key is an account or an address. A login ends the row of both: at the belt all persons have
    one address, and the mistakes of a shift would add up. Who has an account of his own could so
    have his address try the others without a wait, were it not for the row of each of these, which
    only its own login ends. `clock` is in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: dict[str, tuple[int, float]] = {}  # count, time of last

    def wait(self, *keys: str) -> float:
        """Return the time in s until the next attempt of all keys, 0 if it may be made."""
        now = self._clock()
        return max(0.0, *(self._until(key) - now for key in keys))

    def _until(self, key: str) -> float:
        count, last = self._failures.get(key, (0, 0.0))
        return last + min(2.0 ** (count - _FREE), _LONGEST) if count >= _FREE else 0.0

    def fail(self, *keys: str) -> None:
        """Note a failure of some keys."""
        now = self._clock()
        for key in keys:
            count, last = self._failures.get(key, (0, now))
            self._failures[key] = (1 if now - last > _FORGOTTEN else min(count + 1, 64)), now

    def forget(self, *keys: str) -> None:
        """Forget the failures of some keys, which have logged in."""
        for key in keys:
            self._failures.pop(key, None)

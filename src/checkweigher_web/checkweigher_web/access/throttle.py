# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Waiting times after failed logins, for each account and each address."""

from collections.abc import Callable
import time

_FREE = 3  # failures before the first wait, because persons mistype
_LONGEST = 300.0  # s
_FORGOTTEN = 3600.0  # s after the last failure


class Throttle:
    """Waiting times after failures in a row: 1 s after the third, then doubled, at most 5 min.

    A key is an account or an address. A login resets the failures of its account and of its
    address, because all persons at the belt share one address. The failures of any other account
    still count. Otherwise a user could guess the passwords of other users from the same address.
    `clock` is in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: dict[str, tuple[int, float]] = {}  # count, time of last

    def wait(self, *keys: str) -> float:
        """Return the time in s until all keys may make the next attempt."""
        now = self._clock()
        return max(0.0, *(self._until(key) - now for key in keys))

    def _until(self, key: str) -> float:
        count, last = self._failures.get(key, (0, 0.0))
        return last + min(2.0 ** (count - _FREE), _LONGEST) if count >= _FREE else 0.0

    def fail(self, *keys: str) -> None:
        """Add a failure of each key."""
        now = self._clock()
        for key in keys:
            count, last = self._failures.get(key, (0, now))
            self._failures[key] = (1 if now - last > _FORGOTTEN else min(count + 1, 64)), now

    def forget(self, *keys: str) -> None:
        """Remove the failures of keys that have logged in."""
        for key in keys:
            self._failures.pop(key, None)

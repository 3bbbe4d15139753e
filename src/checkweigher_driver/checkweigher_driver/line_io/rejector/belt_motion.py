# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of the belt: measured by an input, or as line and watchdog of the machine allow it."""

from checkweigher_driver.line_io.rejector.reject_pulses import BeltTime


class BeltMotion:
    """What is known of the motion of the belt. Times are in ns of the clock of `now`.

    `measured` is whether the belt input is on, None without one. `released` is true if the belt may
    have run since it was known to be empty. After `watchdog_time` without a sign of life the
    machine stops its belt by itself.
    """

    def __init__(self, watchdog_time: int) -> None:
        self.time = BeltTime()
        self.measured: bool | None = None
        self.released = False
        self._watchdog_time = watchdog_time
        self._may_run = False  # as the line has allowed last
        self._stopped_at: int | None = None  # when the line last stopped it without a belt input
        self._sign: tuple[int, bool] | None = None  # last sign of life; whether it might run then

    def measure(self, running: bool | None, now: int) -> int | None:
        """Process the belt input, and return the time of the belt if it runs again after a stop."""
        self.measured = running
        if running is False:
            self.time.stop(now)
        return self.time.run(now) if running and self.time.stopped else None

    def allow(self, run: bool, now: int) -> bool:
        """Process whether the line lets the belt run; return whether it is stopped unmeasured.

        The places of the items on it are not known then.
        """
        self._may_run = run
        unmeasured = not run and self.released and self.measured is None
        if unmeasured:
            self._stopped_at = now
        self.released |= run
        return unmeasured

    def was_stopped_since(self, time: int | None) -> bool:
        """Return whether the line has stopped the belt, unmeasured, after a time."""
        return time is not None and self._stopped_at is not None and time < self._stopped_at

    def sign_of_life(self, begun: int) -> None:
        """Process a sign of life that the machine got after `begun`."""
        self._sign = begun, self._may_run

    def is_silent(self, now: int) -> bool:
        """Return, once, whether a belt that ran was stopped for want of a sign of life."""
        last, ran = self._sign or (now, False)
        if not ran or now - last <= self._watchdog_time:
            return False
        self._sign = None
        return True

    def clear(self) -> None:
        """Begin again with a belt that stands and is empty."""
        self.released = self._may_run = False
        self._sign = None

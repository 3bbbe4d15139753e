# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of the belt: measured by an input, or inferred from line and watchdog."""

from checkweigher_driver.line_io.rejector.reject_pulses import BeltTime


class BeltMotion:
    """Known motion of the belt. Times are in ns of the clock of `now`.

    `measured` is the state of the belt input, None without one. `released` is true if the belt may
    have run since it was known to be empty. After `watchdog_time` without a sign of life the
    machine stops its belt by itself.
    """

    def __init__(self, watchdog_time: int) -> None:
        self.time = BeltTime()
        self.measured: bool | None = None
        self.released = False
        self._watchdog_time = watchdog_time
        self._may_run = False  # by the last decision of the line
        self._stopped_at: int | None = None  # last stop by the line without a belt input
        self._sign: tuple[int, bool] | None = None  # last sign of life; whether it might run then

    def measure(self, running: bool | None, now: int) -> int | None:
        """Process the belt input, and return the time of the belt if it runs again after a stop."""
        self.measured = running
        if running is False:
            self.time.stop(now)
        return self.time.run(now) if running and self.time.stopped else None

    def allow(self, run: bool, now: int) -> bool:
        """Process whether the line lets the belt run; return whether it is stopped unmeasured.

        The places of the items on it are then unknown.
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
        """Return, once, whether the machine stopped the belt because no sign of life came."""
        last, ran = self._sign or (now, False)
        if not ran or now - last <= self._watchdog_time:
            return False
        self._sign = None
        return True

    def clear(self) -> None:
        """Begin again with an empty belt at rest."""
        self.released = self._may_run = False
        self._sign = None

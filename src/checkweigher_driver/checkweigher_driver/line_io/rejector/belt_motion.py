# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of the belt, measured by a belt input or inferred from the outputs."""

from checkweigher_driver.line_io.rejector.reject_pulses import BeltTime


class BeltMotion:
    """Motion of the belt. Times are in ns on the monotonic clock.

    `measured` is whether the belt runs according to the belt input, or None if there is no belt
    input or it cannot be read. `released` is true if the belt may have run since it was known to be
    empty. After `watchdog_time` without a heartbeat the machine stops its belt by itself.
    """

    def __init__(self, watchdog_time: int) -> None:
        self.time = BeltTime()
        self.measured: bool | None = None
        self.released = False
        self._watchdog_time = watchdog_time
        self._may_run = False
        # Time of the last heartbeat in ns, and whether the belt was allowed to run then.
        self._heartbeat: tuple[int, bool] | None = None
        self._stopped_at: int | None = None  # time in ns of the last unmeasured stop

    def measure(self, running: bool | None, now: int) -> int | None:
        """Record the state of the belt input; return the belt time if the belt starts, or None.

        `running` is None if there is no belt input. The belt starts if `running` is true and the
        belt was stopped before.
        """
        self.measured = running
        if running is False:
            self.time.stop(now)
        return self.time.run(now) if running and self.time.stopped else None

    def allow(self, run: bool, now: int) -> bool:
        """Allow or forbid the belt to run; return whether the positions of its items are unknown.

        The positions are unknown if the belt must not run, may have run since it was known to be
        empty, and no belt input measures the time of the stop.
        """
        self._may_run = run
        unmeasured = not run and self.released and self.measured is None
        if unmeasured:
            self._stopped_at = now
        self.released |= run
        return unmeasured

    def was_stopped_since(self, time: int | None) -> bool:
        """Return whether the belt was stopped after `time`, and no belt input measured the stop.

        Returns False if `time` is None.
        """
        return time is not None and self._stopped_at is not None and time < self._stopped_at

    def heartbeat(self, begun: int) -> None:
        """Record a heartbeat that was sent after time `begun`."""
        self._heartbeat = begun, self._may_run

    def is_silent(self, now: int) -> bool:
        """Return whether the machine has stopped the belt because it got no heartbeat.

        True is returned only once for each stop.
        """
        last, ran = self._heartbeat or (now, False)
        if not ran or now - last <= self._watchdog_time:
            return False
        self._heartbeat = None
        return True

    def clear(self) -> None:
        """Record that the belt is empty and must not run.

        The belt time and the state of the belt input are not changed.
        """
        self.released = self._may_run = False
        self._heartbeat = None

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rules by which a process of the line is started again, or killed because it hangs."""

from enum import Enum, auto
import signal

CANNOT_START = 2  # exit status of a node whose parameters cannot be used
# s, before a process is started again: at first, and at most where it dies again and again.
DELAY, LONGEST_DELAY = 1.0, 10.0
STABLE = 5.0  # s; a process that has lived for so long has not died at once
SILENCE = 5.0  # s without diagnostics after which a process hangs
START = 30.0  # the same for a process that was just started


class Action(Enum):
    """What has to be done about a process."""

    NOTHING = auto()
    START = auto()
    KILL = auto()
    GIVE_UP = auto()


class Supervision:
    """State of one process, and what to do about it; times are s on a clock that never steps back.

    `reason` says why the process ended last. A process without `reports` sends no diagnostics: the
    supervisor cannot tell whether it hangs, and takes it to have worked once it was started.
    """

    def __init__(self, *, reports: bool = True) -> None:
        self.reason = ''
        self._reports = reports
        self._delay = DELAY
        self._started: float | None = None
        self._ended: float | None = None
        self._heard: float | None = None
        self._was_up = not reports
        self._cannot_start = False
        self._hung = False

    def started(self, now: float) -> float:
        """Note that the process was started and return how long it was not there, s."""
        away = 0.0 if self._ended is None else now - self._ended
        self._started, self._ended, self._heard, self._hung = now, None, None, False
        return away

    def heard(self, now: float) -> None:
        """Note that diagnostics of the process came."""
        if self._ended is None and self._started is not None:
            self._heard, self._was_up = now, True

    def ended(self, now: float, status: int) -> None:
        """Note that the process has ended, with a status as of `subprocess`: -N for signal N."""
        if self._started is not None:
            at_once = now - self._started < STABLE
            longer = min(2 * self._delay, LONGEST_DELAY)
            self._delay = longer if at_once and self.reason else DELAY
        # Once it has worked, its parameters are good and it is worth another try.
        self._cannot_start = status == CANNOT_START and not self._was_up
        silence = f'hung: no diagnostics for {SILENCE:g} s'
        self.reason = silence if self._hung else _reason(status)
        self._started, self._ended = None, now

    def due(self, now: float) -> Action:
        """Return what has to be done now."""
        if self._started is None:
            if self._cannot_start:
                return Action.GIVE_UP
            waited = self._ended is None or now - self._ended >= self._delay
            return Action.START if waited else Action.NOTHING
        since, longest = (self._started, START) if self._heard is None else (self._heard, SILENCE)
        if self._reports and now - since > longest and not self._hung:
            self._hung = True
            return Action.KILL
        return Action.NOTHING


def _reason(status: int) -> str:
    if status < 0:
        try:
            return f'killed by signal {-status} ({signal.Signals(-status).name})'
        except ValueError:
            return f'killed by signal {-status}'
    return f'ended with status {status}'

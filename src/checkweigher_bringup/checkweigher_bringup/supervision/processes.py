# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Supervised processes, which are restarted after they end, and killed if they hang."""

from collections.abc import Callable, Sequence
from contextlib import suppress
import math
import signal
import sys
import time

from checkweigher_bringup.spinning import Process, end_process, start_process
from checkweigher_core.parent_process import CANNOT_START

# Delay in s before a restart. The delay doubles, up to the longest delay, while the process keeps
# ending within `STABLE` s.
DELAY, LONGEST_DELAY = 1.0, 10.0
STABLE = 5.0  # time in s after which a process is considered to work
SILENCE = 5.0  # time in s without diagnostics after which a process is killed
START = 30.0  # maximum time in s from the start of a process to its first diagnostics


class SupervisedProcess:
    """Process that is kept running. Times are in s on a monotonic clock.

    `command` is called at each start, and returns the words of the command. The process is not
    restarted if it ends with the status `CANNOT_START` before it has worked. If `reports` is True,
    the process counts as having worked as soon as its first diagnostics have arrived, and is killed
    if the diagnostics stop. If `reports` is False, the process counts as having worked after
    `STABLE` s, and is not killed if it hangs. If `kept` is False, the process is started only once,
    and systemd has to kill it if it hangs.
    """

    def __init__(
        self,
        name: str,
        command: Callable[[], Sequence[str]],
        *,
        reports: bool = True,
        kept: bool = True,
    ) -> None:
        self._name = name
        self._command = command
        self._reports = reports
        self._kept = kept
        self.renew()

    def renew(self) -> None:
        """Reset the state of this object, so that the next call of `look` starts the process.

        The process must have ended.
        """
        self._child: Process | None = None
        self._reason = ''  # reason of the latest end
        self._delay = DELAY
        self._has_worked = self._given_up = self._hung = False
        self._started = self._ended = self._awaited = -math.inf

    def heard(self, now: float) -> None:
        """Record that diagnostics of the process arrived."""
        if self._child is not None:
            self._has_worked, self._awaited = True, now + SILENCE

    def look(self, now: float) -> bool:
        """Start or kill the process if necessary.

        Returns False if the process has ended and will not be started again, otherwise True.
        """
        if self._child is not None:
            status = self._child.poll()
            if status is not None:
                self._record_end(now, status)
            elif self._reports and self._kept and now > self._awaited:
                self._hung = True
                self._child.kill()
        if self._child is None and not self._given_up and now >= self._ended + self._delay:
            self._child = start_process(self._command())
            if self._reason:
                say(f'{self._name}: {self._reason}; restarted after {now - self._ended:.1f} s')
            self._started, self._awaited, self._hung = now, now + START, False
        return not self._given_up

    def _record_end(self, now: float, status: int) -> None:
        at_once = now - self._started < STABLE
        self._delay = min(2 * self._delay, LONGEST_DELAY) if at_once and self._reason else DELAY
        self._has_worked |= not (self._reports or at_once)
        self._given_up = not self._kept or (status == CANNOT_START and not self._has_worked)
        self._reason = f'hung: no diagnostics for {SILENCE:g} s' if self._hung else _reason(status)
        self._child, self._ended = None, now
        if not self._kept:
            say(f'{self._name}: {self._reason}')

    def terminate(self) -> None:
        """Send SIGTERM to the process if it runs."""
        if self._child is not None:
            self._child.terminate()

    def wait(self) -> None:
        """Wait until the process has ended. If it does not end within 5 s, kill it."""
        if self._child is not None and not end_process(self._child):
            say(f'{self._name}: did not end in time; killed')


def say(text: str) -> None:
    """Print a line with the time on stderr."""
    # Ignore the error of a closed terminal, because the processes must continue to run.
    with suppress(OSError):
        print(f'{time.strftime("%H:%M:%S")} {text}', file=sys.stderr, flush=True)


def _reason(status: int) -> str:
    if status >= 0:
        return f'ended with status {status}'
    names = {int(each): f' ({each.name})' for each in signal.Signals}
    return f'killed by signal {-status}{names.get(-status, "")}'

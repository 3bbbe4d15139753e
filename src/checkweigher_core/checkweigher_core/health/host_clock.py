# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steps of the clock of this host, and synchronisation of the clock as reported by chrony."""

from collections.abc import Sequence
import math
import shutil
import subprocess
import time

from checkweigher_core.health.findings import Finding, Level, conclude, warn_if

COMMAND = ('chronyc', '-n', '-c', 'tracking')
_ASPECT = 'Host clock'
_UNKNOWN = 'not known yet'
_PERIOD = 30.0  # time in s between two calls of chronyc
_PATIENCE = 10.0  # longest wait in s for the output of chronyc
_LARGEST_BOUND = 0.1  # largest bound of the clock error in s without a warning
_STEP = 0.5  # smallest reported step in s; longer than the time between two clock readings
_OWN_CLOCK = 0x7F7F0101  # reference ID of a chronyd that follows its own clock (option local)


class ClockSteps:
    """Detector of steps of the clock of this host."""

    def __init__(self) -> None:
        self._offset = self._difference()

    def step(self) -> float:
        """Return the step of the clock in s since the previous call, positive for a forward step.

        The result is 0 if the clock was not set, or was set by less than 0.5 s in total. The first
        call returns the step since the detector was created.
        """
        before, self._offset = self._offset, self._difference()
        step = self._offset - before
        return step if abs(step) >= _STEP else 0.0

    def _difference(self) -> float:
        # Compare the clock with the boot clock, which is never set, and which goes on while the
        # computer sleeps.
        return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)


class HostClock:
    """Monitor of the synchronisation of the clock of this host by chrony.

    A call of `finding` starts the command chronyc in a separate process, and a later call reads its
    output, so that the node never waits for chronyc. If chronyc runs for more than 10 s, the
    process is killed.
    """

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        self._command = command
        self._exists = shutil.which(command[0]) is not None
        self._asked = -math.inf
        self._question: subprocess.Popen[str] | None = None
        self._finding = conclude(
            _ASPECT, _UNKNOWN if self._exists else 'not checked: chrony is not installed'
        )

    @property
    def reference(self) -> str:
        """Text on the time reference of the clock of this host, empty if not known yet.

        The text contains no numbers, so that it changes only with the time reference.
        """
        if 'bound_ms' in self._finding.values:
            return 'synchronised by chrony'
        return '' if self._finding.text == _UNKNOWN else self._finding.text

    def finding(self, now: float) -> Finding:
        """Return the finding "Host clock" at time `now` in s on a monotonic clock."""
        if self._question is not None:
            if self._question.poll() is not None:
                self._finding = tracking_finding(self._question.communicate()[0])
                self._question = None
            elif now - self._asked > _PATIENCE:
                self._question.kill()
        elif self._exists and now - self._asked >= _PERIOD:
            self._asked = now
            self._question = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        return self._finding


def tracking_finding(text: str) -> Finding:
    """Return the finding "Host clock" for `text`, the output of ``chronyc -c tracking``.

    The clock error is at most the sum of the absolute offset of the system clock, the root
    dispersion and half of the root delay (see the manual of chronyc).
    """
    fields = text.strip().split(',')
    try:
        reference, leap = int(fields[0], 16), fields[13]
        bound = abs(float(fields[4])) + float(fields[11]) + float(fields[10]) / 2
    except (IndexError, ValueError):
        hint = 'check that chronyd runs, and that chronyc tracking works for this user'
        return Finding(_ASPECT, Level.WARN, 'chrony does not answer', hint)
    if reference == 0 or leap == 'Not synchronised':
        hint = 'check chronyc sources, and the network to the time servers'
        return Finding(_ASPECT, Level.WARN, 'the clock is not synchronised', hint)
    if reference == _OWN_CLOCK:
        return conclude(_ASPECT, 'this clock is its own reference in chrony (local)')
    text = f'accurate to {1e3 * bound:.3g} ms according to chrony'
    hint = 'check chronyc sources; times cannot be compared with those of other hosts'
    return conclude(
        _ASPECT, text, [warn_if(bound > _LARGEST_BOUND, text, hint)], {'bound_ms': 1e3 * bound}
    )

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What chrony says of the clock of this host, by its command chronyc."""

from collections.abc import Sequence
import subprocess
import threading

from checkweigher_dsp.health.host_clocks import KeptClock

COMMAND = ('chronyc', '-n', '-c', 'tracking')
_PERIOD = 5.0  # s
_PATIENCE = 2.0  # s
_OWN_CLOCK = 0x7F7F0101  # reference of a chrony that follows nobody (`local`)
_FIELDS = 14


class Chrony:
    """The clock of this host as chrony `kept` it lately; None where no chrony keeps it.

    A thread asks by `command` while the block lasts.
    """

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        self.kept: KeptClock | None = None
        self._command = tuple(command)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._ask_again, name='chrony', daemon=True)

    def __enter__(self) -> 'Chrony':
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _ask_again(self) -> None:
        while True:
            self.kept = self._ask()
            if self._ended.wait(_PERIOD):
                return

    def _ask(self) -> KeptClock | None:
        try:
            done = subprocess.run(
                self._command, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                timeout=_PATIENCE,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired):
            return None
        return read_tracking(done.stdout) if done.returncode == 0 else None


def read_tracking(text: str) -> KeptClock | None:
    """Return the clock by what ``chronyc -c tracking`` prints; None if it is not kept.

    The bound of its error is that of the manual of chronyc: offset of the system clock, root
    dispersion, and half of the root delay.
    """
    fields = text.strip().split(',')
    try:
        reference, offset = int(fields[0], 16), float(fields[4])
        delay, dispersion = float(fields[10]), float(fields[11])
    except (IndexError, ValueError):
        return None
    if len(fields) != _FIELDS or fields[13] == 'Not synchronised' or reference in (0, _OWN_CLOCK):
        return None
    return KeptClock(reference, abs(offset) + dispersion + delay / 2)

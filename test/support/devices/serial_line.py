# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Starting a serial device in a process of its own, and reading a source in a thread."""

from collections.abc import Callable
from pathlib import Path
import subprocess
import sys
import threading
import time

from running import PATIENCE

from checkweigher_driver.devices import source_class

PROGRAM = Path(__file__).with_name('serial_device.py')


RATE = 1200.0
CELL = {'counts_per_kg': 5e5, 'capacity': 7.2, 'weigh_length': 0.2}
# Source, its parameters, options of the device.
LINES = {
    'aed with CR LF': ('aed', {}, ()),
    'aed without CR LF': ('aed', {}, ('--trailer', 'none')),
    'aed without checksum': ('aed', {'checksum': False}, ()),
    'ascii': ('ascii', {'baud_rate': 230_400}, ('--protocol', 'ascii', '--baud', 230_400)),
}


def make(name, link, **values):
    """Open a source on a port."""
    kind = source_class(name)
    given = {'port': str(link), 'sample_rate': RATE, 'timeout': 1.0, **CELL, **values}
    return kind(kind.parameters.from_mapping(given))


def aed_on(port, cell):
    """Return parameters of the driver for a load cell on a port."""
    names = ('sample_rate', 'counts_per_kg', 'zero_counts', 'capacity', 'weigh_length')
    values = {f'aed.{name}': getattr(cell, name) for name in names}
    return {'source': 'aed', 'aed.port': str(port), **values}


class SerialDevice:
    """A device program and the port that it makes."""

    def __init__(self, link: Path, *options: object) -> None:
        self.link = link
        self._process = subprocess.Popen(
            [sys.executable, PROGRAM, link, *map(str, options)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout.readline() == 'ready\n'

    def tell(self, command: str) -> None:
        """Have the device do something; return when it has."""
        print(command, file=self._process.stdin, flush=True)
        assert self._process.stdout.readline() == 'done\n'

    def end(self) -> None:
        self._process.stdin.close()
        assert self._process.wait(PATIENCE) == 0
        self._process.stdout.close()


class Reader:
    """Collect what a source yields."""

    def __init__(self, source) -> None:
        self.source = source
        self.events = []
        self.error = None
        self.host_late = 0.0  # the most that a wait ended late, s: how busy the host is
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            for event in self.source:
                self.events.append(event)
        except Exception as error:
            self.error = error

    def wait_for(self, condition: Callable[[], object], patience: float = PATIENCE) -> float:
        """Wait until a condition holds; return how long that took, s."""
        begin = time.monotonic()
        while not condition():
            since = time.monotonic()
            assert since - begin < patience, (self.source.figures(), self.source.trouble)
            time.sleep(0.005)
            self.host_late = max(self.host_late, time.monotonic() - since - 0.005)
        return time.monotonic() - begin

    @property
    def end_index(self) -> int:
        return self.events[-1].first_index + len(self.events[-1].counts) if self.events else 0

    def wait_for_samples(self, number: float, patience: float = PATIENCE) -> float:
        """Wait until so many more samples have come than by now."""
        until = self.end_index + number
        return self.wait_for(lambda: self.end_index >= until, patience)

    def close(self) -> float:
        """Close the source; return how long its iterator took to end, s."""
        begin = time.monotonic()
        self.source.close()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        return time.monotonic() - begin

    def wait_for_end(self) -> None:
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

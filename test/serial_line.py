"""Starting a serial device in a process of its own, and reading a source in a thread."""

from collections.abc import Callable
from pathlib import Path
import subprocess
import sys
import threading
import time

PROGRAM = Path(__file__).with_name('serial_device.py')
PATIENCE = 20.0  # s, after which something hangs


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
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            for event in self.source:
                self.events.append(event)
        except Exception as error:
            self.error = error

    def wait_for(self, condition: Callable[[], object]) -> float:
        """Wait until a condition holds; return how long that took, s."""
        begin = time.monotonic()
        while not condition():
            assert time.monotonic() - begin < PATIENCE, (self.source.figures(), self.source.trouble)
            time.sleep(0.005)
        return time.monotonic() - begin

    @property
    def end_index(self) -> int:
        return self.events[-1].first_index + len(self.events[-1].counts) if self.events else 0

    def wait_for_samples(self, number: int) -> float:
        """Wait until so many more samples have come than by now."""
        until = self.end_index + number
        return self.wait_for(lambda: self.end_index >= until)

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

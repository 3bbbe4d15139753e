# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""File with the latest item numbers of a node, which the next process of the node reads."""

import os
from pathlib import Path
import time

from checkweigher_core.parent_process import parent_identity
from checkweigher_core.records import NUMBERS_AT_ONCE
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.state_files import make_folder, state_file, sync_folder

_LINE = 100  # length in bytes of the first line, which identifies the run
_NUMBER = 21  # length in bytes of each further line, which contains one number.
# First line of a file with a path. A file with a path is valid in all runs, so that its first line
# does not identify a run.
_KEPT = 'kept over runs'


class GivenNumbers:
    """File with the latest item numbers of a node.

    A run is one process of `run` or `ros2 launch`, which restarts its nodes. A restarted node
    continues the numbers. In the next run, the numbers begin at 1 unless a `path` is set. With a
    path, an empty file with the suffix `.begun` shows that numbers were used. If numbers were used
    and their file is damaged or missing, the last number is the number of milliseconds since 1970,
    because no line can have weighed more items.

    `node` is the full name of the node, or empty if no numbers are stored. Without a `path`, the
    file is named after the node and its ROS `domain`. The file contains the `most` latest numbers.
    """

    def __init__(self, node: str = '', domain: int = 0, path: str = '', most: int = 1) -> None:
        self.numbers: frozenset[int] = frozenset()  # latest numbers of earlier processes
        self.last = 0  # largest number that an earlier process may have used, or 0
        self.trouble = ''  # reason why numbers are unknown or cannot be stored, or empty
        self._most = most
        self._file: int | None = None
        if not node:
            return
        try:
            file = Path(path) if path else state_file(f'{node.strip("/")}.{domain}.numbers')
            make_folder(file.parent)
            begun = file.with_name(f'{file.name}.begun')
            known = file.exists() or begun.exists()
            self._file = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            whole = self._begin(self._file, _KEPT if path else parent_identity())
            self.last = max(self.numbers, default=0)
            if path and known and not whole:
                self.trouble = f'{file}: was damaged or removed, so its numbers are unknown'
                self.last = time.time_ns() // 1_000_000
            if path:
                begun.touch()
            sync_folder(file.parent)
        except (OSError, RuntimeError) as error:
            self._fail(error)

    def _begin(self, file: int, run: str) -> bool:
        """Read the file, or write an empty one for a new run. Returns whether the file was intact.

        A file is intact if its first line identifies this run, and if its other lines are all blank
        or at least one of them contains a number.
        """
        line = run[: _LINE - 1].ljust(_LINE - 1) + '\n'
        data = os.pread(file, _LINE + self._most * _NUMBER, 0).decode(errors='replace')
        places = data[_LINE:].splitlines() if data.startswith(line) else []
        if not places:
            os.ftruncate(file, 0)
            os.pwrite(file, line.encode() + (b' ' * (_NUMBER - 1) + b'\n') * self._most, 0)
        # Ignore lines that are incomplete or were never written, which are not decimal numbers.
        found = {int(text): n for n, text in enumerate(places) if text.strip().isdecimal()}
        self.numbers = frozenset(found)
        # If there is no blank line, overwrite the smallest number. The smallest number need not
        # follow the largest, because numbers are not always written in ascending order.
        free = [place for place, text in enumerate(places) if not text.strip()]
        oldest = found[min(found)] if found else 0
        self._next = free[0] if free else oldest
        self._on_disk = -1
        return bool(places) and (bool(found) or len(free) == len(places))

    def give(self, number: int) -> None:
        """Write a number to the file before the number is used.

        If the number cannot be written, `trouble` is set, and no further number is written. A
        written number remains in the file even if the process is killed. The file does not grow, so
        that it can be written on a full disk. Only the first number after a start and the first
        number of each thousand are synchronised with the disk. Numbers that are lost in a power
        failure are not used again, because the segmenter continues at the next thousand.
        """
        if self._file is None:
            return
        try:
            data = f'{number:{_NUMBER - 1}d}\n'.encode()
            os.pwrite(self._file, data, _LINE + self._next % self._most * _NUMBER)
            self._next += 1
            if number // NUMBERS_AT_ONCE != self._on_disk:
                os.fsync(self._file)
                self._on_disk = number // NUMBERS_AT_ONCE
        except OSError as error:
            self._fail(error)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _fail(self, error: Exception) -> None:
        self.trouble = f'item numbers are not stored for a restart: {error}'
        self.close()


def open_numbers(node: PortNode, path: str, most: int = 1) -> GivenNumbers:
    """Return the file with the numbers of a node.

    The node logs a problem with the file as a warning.
    """
    name, domain = node.get_fully_qualified_name(), node.context.get_domain_id()
    numbers = GivenNumbers(name, domain, path, most)
    if numbers.trouble:
        node.warn(numbers.trouble)
    return numbers

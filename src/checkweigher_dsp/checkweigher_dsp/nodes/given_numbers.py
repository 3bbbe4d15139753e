# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The numbers that the reject nodes of a run have given, in a file that outlives their process."""

from contextlib import suppress
import os

from checkweigher_dsp.parent_process import parent_identity
from checkweigher_dsp.state_files import state_file


class GivenNumbers:
    """The file of the reject node of a lane; `last` is the largest number that has been given.

    A run is what one process has started: `run`, `replay` or `ros2 launch`, which starts a node
    again that has ended. Its children count on from each other. In another run items count from 1.

    `trouble` says why the file cannot be used, empty if it can; the history of the driver has the
    numbers as well.
    """

    def __init__(self, node: str, domain: int) -> None:
        self.last = 0
        self.trouble = ''
        self._run = parent_identity()
        self._file: int | None = None
        try:
            path = state_file(f'{node.strip("/")}.{domain}.numbers')
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            self.last = self._read(self._file)
        except (OSError, RuntimeError) as error:
            self._fail(error)

    def give(self, number: int) -> None:
        """Note a number that is about to be given. No disk is waited for: only a kill is outlived.

        What is written has the same length each time: a full disk takes it.
        """
        if self._file is None or number <= self.last:
            return
        self.last = number
        try:
            os.pwrite(self._file, f'{self._run} {number:020d}\n'.encode(), 0)
        except OSError as error:
            self._fail(error)

    def close(self) -> None:
        """Let go of the file, which stays."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _read(self, file: int) -> int:
        run, _, number = os.pread(file, 200, 0).partition(b'\n')[0].rpartition(b' ')
        if run.decode(errors='replace') == self._run:
            with suppress(ValueError):  # torn
                return int(number)
        return 0

    def _fail(self, error: Exception) -> None:
        self.trouble = f'the numbers of items are not kept over a restart: {error}'
        self.close()

# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""State of the belt in a file that outlives a driver which is killed.

The file says that the belt may run before it does, on the disk. So the next start notices any end
that was not orderly, also a power cut. The names of the items are written by a thread of their own
and need not outlive a power cut, so that the outputs never wait for a disk.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
import fcntl
import json
import os
from pathlib import Path

from checkweigher_core.parameters import ParameterError
from checkweigher_core.state_files import state_file

_SIZE = 16_384  # bytes, allocated at the start, so that a full disk does no harm later
_NAME = 'rejector.record'


@dataclass(frozen=True)
class OnBelt:
    """State of the belt at the end of a run.

    `released` is true if the belt may have run since it was known to be empty, `items` are the
    names of the items on it, `doubts` the texts of missed products that no person has looked for.
    """

    released: bool = False
    items: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def to_look_for(self) -> tuple[str, ...]:
        """Return texts of all that is in doubt at a start; empty after an orderly end."""
        if not self.released:
            return self.doubts
        known = f'{", ".join(self.items)}, and ' if self.items else ''
        return (
            *self.doubts,
            f'the line did not end with an empty belt: look for {known}what has entered since',
        )


class BeltRecord:
    """The file of one machine, locked for one driver at a time.

    `found` is the state at the end of the run before.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise self._refusal(error) from None
        try:
            self.found = self._open()
        except OSError as error:
            os.close(self._file)
            raise self._refusal(error) from None
        self._kept = OnBelt()
        self._writer = ThreadPoolExecutor(1, 'belt record')
        self._writing = self._writer.submit(lambda: None)  # the last write

    def _refusal(self, error: OSError) -> ParameterError:
        why = error.strerror or str(error)
        if isinstance(error, BlockingIOError):
            why = 'another driver has it, and so these outputs'
        return ParameterError(
            f'{_NAME}: {str(self._path)!r}: {why}; must be a file that outlives this process'
        )

    def _open(self) -> OnBelt:
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        data = os.pread(self._file, _SIZE, 0)
        os.posix_fallocate(self._file, 0, _SIZE)
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        return _parse(data) if data else OnBelt()

    def keep(self, belt: OnBelt) -> None:
        """Write the state of the belt: to the disk before it is released, else soon.

        Raises OSError if it cannot be written; the belt must not run then.
        """
        if belt.released and self._writing.done():
            self._writing.result()
        if belt == self._kept:
            return
        released, self._kept = self._kept.released, belt
        self._writing = self._writer.submit(self._write, belt)
        if belt.released and not released:
            self._writing.result()
            os.fsync(self._file)

    def _write(self, belt: OnBelt) -> None:
        data = json.dumps([belt.released, belt.items, belt.doubts]).encode()
        try:
            os.pwrite(self._file, data[: _SIZE - 1] + b'\n', 0)
        except OSError as error:
            why = error.strerror or error
            raise OSError(f'{_NAME}: {str(self._path)!r}: {why}') from None

    def close(self, belt: OnBelt) -> None:
        """Write the state of the belt at the end to the disk."""
        self._writer.shutdown()
        try:
            self._write(belt)
            os.fsync(self._file)
        finally:
            os.close(self._file)


def _parse(data: bytes) -> OnBelt:
    """Return the content of a file; if it is damaged, the belt may have run."""
    try:
        released, items, doubts = json.loads(data.split(b'\n', 1)[0])
        return OnBelt(bool(released), tuple(map(str, items)), tuple(map(str, doubts)))
    except (ValueError, TypeError):
        return OnBelt(released=True)


def record_path(wanted: str, machine: str) -> Path:
    """Return the path of the record of a machine, by the name of its outputs if none is given."""
    if wanted:
        return Path(wanted)
    try:
        return state_file(f'{machine}.belt')
    except RuntimeError:
        raise ParameterError(f'{_NAME}: empty, and this user has no home folder') from None

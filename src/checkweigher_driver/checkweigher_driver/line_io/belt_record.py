# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Memory of what is on the belt, in a file that outlives a driver which is killed.

That the belt may run is on the disk before it does, so that any end but an orderly one is seen at
the next start, after a power cut as well. The names of the items follow in a thread of their own,
and need no power cut to be survived: nobody waits for a disk.
"""

from dataclasses import dataclass
import fcntl
import json
import os
from pathlib import Path
import threading

from checkweigher_core.parameters import ParameterError
from checkweigher_core.state_files import state_file

_SIZE = 16_384  # bytes, which the file has from the start: a full disk is no trouble later
_NAME = 'rejector.record'


@dataclass(frozen=True)
class OnBelt:
    """What a start has to know of the run before it.

    `released` tells whether the belt may have run since it was known to be empty, `items` names
    what was on it, `doubts` has what a person had not looked for yet.
    """

    released: bool = False
    items: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def to_look_for(self) -> tuple[str, ...]:
        """Return what is in doubt at a start, in words; empty after an orderly end."""
        if not self.released:
            return self.doubts
        known = f'{", ".join(self.items)}, and ' if self.items else ''
        return (
            *self.doubts,
            f'the line did not end with an empty belt: look for {known}what has entered since',
        )


class BeltRecord:
    """The file of one machine, locked for one driver at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._changed = threading.Condition()
        self._writing = threading.Lock()
        self._wanted = self._written = OnBelt()
        self._failure = ''
        self._closing = False
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
        self._thread = threading.Thread(target=self._follow, name='belt record', daemon=True)
        self._thread.start()

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
        """Keep what is on the belt; before it may run that is on the disk, else it is soon.

        Raises OSError where it cannot be written: then the belt must not run.
        """
        if belt.released and self._failure:
            raise OSError(self._failure)
        if belt.released and not self._wanted.released:
            self._write(belt)
            os.fsync(self._file)
        elif belt != self._wanted:
            with self._changed:
                self._wanted = belt
                self._changed.notify_all()

    def _write(self, belt: OnBelt | None = None) -> None:
        """Write what is to be kept, and take it from now on if it is given."""
        with self._writing:
            self._wanted = belt = belt or self._wanted
            data = json.dumps([belt.released, belt.items, belt.doubts]).encode()
            os.pwrite(self._file, data[: _SIZE - 1] + b'\n', 0)
            self._written = belt

    def _follow(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._wanted != self._written)
                if self._closing:
                    return
            try:
                self._write()
            except OSError as error:
                self._failure = f'{_NAME}: {str(self._path)!r}: {error.strerror or error}'
                return

    def close(self, belt: OnBelt) -> None:
        """Keep what is on the belt at the end, on the disk."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()
        try:
            self._write(belt)
            os.fsync(self._file)
        finally:
            os.close(self._file)


def _parse(data: bytes) -> OnBelt:
    """Return what a file says; one that cannot be read says that the belt may have run."""
    try:
        released, items, doubts = json.loads(data.split(b'\n', 1)[0])
        return OnBelt(bool(released), tuple(map(str, items)), tuple(map(str, doubts)))
    except (ValueError, TypeError):
        return OnBelt(released=True)


def record_path(wanted: str, machine: str) -> Path:
    """Return where the record of a machine is kept, by the name of its outputs if none is given."""
    if wanted:
        return Path(wanted)
    try:
        return state_file(f'{machine}.belt')
    except RuntimeError:
        raise ParameterError(f'{_NAME}: empty, and this user has no home folder') from None

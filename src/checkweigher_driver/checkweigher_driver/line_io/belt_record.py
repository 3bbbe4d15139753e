# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Record of the state of the belt, in a file that is kept when the driver ends.

The state is on the disk before the belt may run. The next start therefore detects that the driver
was killed or lost its power while items may have been on the belt. The names of the items need not
survive a power cut. A separate thread writes the names, so that the outputs do not wait for the
disk while the belt runs.

An empty file with the suffix `.begun` shows that there was a record. If the `.begun` file exists
without a record, the record was lost, and the belt may have run. If neither the record nor the
`.begun` file exists, the driver starts for the first time.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import astuple, dataclass
import fcntl
import json
import os
from pathlib import Path
from typing import Self
import zlib

from checkweigher_core.parameters import ParameterError
from checkweigher_core.state_files import state_file, sync_folder

# Size of the file in bytes. The file is allocated at the start, because the disk may be full later.
_SIZE = 16_384
_NAME = 'rejector.record'
# Record of an empty belt from an earlier version of the driver, which wrote no checksum.
_EMPTY_BEFORE = b'[false, [], []]'


@dataclass(frozen=True)
class OnBelt:
    """State of the belt.

    `released` is true if the belt may have run since it was known to be empty. `items` contains the
    names of the items on the belt in the form of `BeltItems.names`, which abridges a long list.
    `doubts` contains the messages on missed products for which no person has looked yet.
    """

    released: bool = False
    items: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    @classmethod
    def of_line(cls, data: bytes) -> Self:
        """Return the state in the first line of a record.

        If the record is damaged, `released` is true in the result, and items and doubts are empty.
        """
        line = data.split(b'\n', 1)[0]
        if line == _EMPTY_BEFORE:
            return cls()
        check, _, text = line.partition(b' ')
        with suppress(ValueError, TypeError):
            if int(check, 16) == zlib.crc32(text):
                released, items, doubts = json.loads(text)
                return cls(bool(released), tuple(map(str, items)), tuple(map(str, doubts)))
        return cls(released=True)

    def line(self) -> bytes:
        """Return the state as a line of a record, with its line end."""
        text = json.dumps(astuple(self)).encode()
        return b'%08x %s\n' % (zlib.crc32(text), text)

    def to_look_for(self) -> tuple[str, ...]:
        """Return the messages on what a person has to look for at the next start.

        The result contains the messages on missed products. If the belt may have run since it was
        known to be empty, the last message contains the names of the items on the belt.
        """
        if not self.released:
            return self.doubts
        known = f'{", ".join(self.items)}, and ' if self.items else ''
        return (
            *self.doubts,
            'the belt may not have been empty at the end of the last run: look for '
            f'{known}products that have entered since',
        )


class BeltRecord:
    """File with the state of the belt, locked for one driver at a time.

    `found` is the state at the end of the previous run, or an empty belt at the first start. The
    constructor raises ParameterError if the file cannot be used.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self.found = self._open()
        except OSError as error:
            taken = 'another driver uses this file and its outputs'
            why = taken if isinstance(error, BlockingIOError) else error.strerror or error
            raise ParameterError(
                f'{_NAME}: {str(path)!r}: {why}; must be a file that is kept over a restart'
            ) from None
        # State of the last write, or None if the state on the disk is unknown.
        self._kept: OnBelt | None = OnBelt()
        self._writer = ThreadPoolExecutor(1, 'belt record')
        self._writing = self._writer.submit(lambda: None)  # future of the last write

    def _open(self) -> OnBelt:
        """Open or create the file; return the state at the end of the previous run."""
        path = self._path
        new_folders = [folder for folder in path.parents if not folder.exists()]
        path.parent.mkdir(parents=True, exist_ok=True)
        created = not os.path.lexists(path)
        flags = os.O_RDWR | os.O_CLOEXEC | (os.O_CREAT | os.O_EXCL if created else 0)
        self._file = os.open(path, flags, 0o644)
        try:
            found = self._begin(created)
            for folder in (path, *new_folders):
                sync_folder(folder.parent)
        except OSError as error:
            if created and not isinstance(error, BlockingIOError):
                path.unlink()  # an empty record would count as damaged at the next start
            os.close(self._file)
            raise
        return found

    def _begin(self, created: bool) -> OnBelt:
        """Lock, read and allocate the file, and create `.begun`; return the state of the belt."""
        begun = self._path.with_name(f'{self._path.name}.begun')
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        found = OnBelt.of_line(os.pread(self._file, _SIZE, 0))
        os.posix_fallocate(self._file, 0, _SIZE)
        if created and not begun.exists():
            found = OnBelt()
            self._write(found)
            os.fsync(self._file)
        # A user who may not create `.begun` may not remove the record either, so ignore the error.
        with suppress(PermissionError):
            begun.touch()
        return found

    def keep(self, belt: OnBelt) -> None:
        """Write the state of the belt. If the belt starts, wait until the state is on the disk.

        If the belt does not start, the method does not wait for the thread that writes the state.
        Raises OSError if the state cannot be written, in which case the belt must not run. If the
        belt does not start, a later call in which `belt.released` is true raises the error.
        """
        is_known = self._kept is not None and self._writing.done()
        if belt.released and is_known and (error := self._writing.exception()):
            self._kept = None  # the next call writes the state again
            raise error
        if belt == self._kept:
            return
        starts = belt.released and (self._kept is None or not self._kept.released)
        self._kept = None
        self._writing = self._writer.submit(self._write, belt)
        if starts:
            self._writing.result()
            os.fsync(self._file)
        self._kept = belt

    def _write(self, belt: OnBelt) -> None:
        try:
            os.pwrite(self._file, belt.line()[:_SIZE], 0)
        except OSError as error:
            why = error.strerror or error
            raise OSError(f'{_NAME}: {str(self._path)!r}: {why}') from None

    def close(self, belt: OnBelt) -> None:
        """Write the final state of the belt to the disk, and close the file.

        Raises OSError if the state cannot be written; the file is closed also in this case.
        """
        self._writer.shutdown()
        try:
            self._write(belt)
            os.fsync(self._file)
        finally:
            os.close(self._file)


def record_path(wanted: str, machine: str) -> Path:
    """Return the path `wanted` or, if it is empty, a default path.

    The default path contains `machine`, the name of the outputs. Raises ParameterError if the user
    has no home folder for the default path.
    """
    if wanted:
        return Path(wanted)
    try:
        return state_file(f'{machine}.belt')
    except RuntimeError:
        why = 'empty, must name a file, because this user has no home folder'
        raise ParameterError(f'{_NAME}: {why}') from None
